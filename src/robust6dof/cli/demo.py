"""The main job in one go: track an object with the aerial manipulator's camera and guide it there.

Writes index.html: the flight as a video, its velocities and errors, and what was reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robust6dof.cli.options import CommonOptions


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    category: str = "mug"
    """What to guide to: bottle, bowl, camera, can, laptop or mug."""
    out: Path = Path("out/demo")
    """Folder of the page and of the run's files."""


def run(options: Options) -> None:
    """Fly the run, write the page, say where it lies."""
    from robust6dof.cli import guide
    from robust6dof.simulation.campaign import seed_folder

    flight = guide.Options(
        out=options.out,
        category=options.category,
        seed=options.seed,
        device=options.device,
        processes=1,
        debug=options.debug,
    )
    guide.run(flight)
    folder = seed_folder(options.out, options.seed)
    page = _write_page(options, folder)
    print(f"numbers:  {folder / 'summary.json'}, {folder / 'trace.csv'}")
    print(f"pictures: {folder / 'guidance.mp4'}, velocities.png and errors.png beside it")
    print(f"page:     {page}  (open it in a browser)")


def _write_page(options: Options, folder: Path) -> Path:
    import json

    from robust6dof.visualization.report_page import Section, write_report_page

    summary = json.loads((folder / "summary.json").read_text())
    reached = f"after {summary['time_s']:.1f} s" if summary["reached"] else "no"
    rows = [
        ("both thresholds reached (0.075 rad, 4.0 cm)", reached),
        ("final rotation error", f"{summary['final_rotation_rad']:.3f} rad"),
        ("final translation error", f"{100 * summary['final_translation_m']:.1f} cm"),
        ("tracking error, median", _tracking(summary)),
    ]
    flight = Section(
        f"Guided to a {options.category} by what its camera sees",
        "Left, the onboard view with the tracked pose; right, the scene from outside. The tracker "
        "was given the true pose of the first frame and nothing but images from then on; the "
        "numbers below are measured against the simulation's truth.",
        rows,
        [(folder / "guidance.mp4", f"scenario table, seed {options.seed}")],
    )
    signals = Section(
        "Velocities and errors",
        "PAD-Servo commands the vehicle's velocity and yaw rate and the four joint rates at 20 Hz.",
        media=[
            (folder / "velocities.png", "commanded and achieved velocities and joint rates"),
            (folder / "errors.png", "translation and rotation error over time"),
        ],
    )
    return write_report_page(options.out / "index.html", "robust6dof demo", [flight, signals])


def _tracking(summary: dict[str, float | None]) -> str:
    angle, distance = summary["tracking_error_deg"], summary["tracking_error_m"]
    if angle is None or distance is None:
        return "not measured"
    return f"{angle:.1f}°, {100 * distance:.1f} cm"
