"""Guide the simulated aerial manipulator to an object with PAD-Servo, for one seed or many."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from robust6dof.cli.guide_report import line_of, report
from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    from robust6dof.robot.aerial_manipulator import AerialManipulator
    from robust6dof.servo.config import Law
    from robust6dof.simulation.episode import Episode
    from robust6dof.simulation.guidance import GuidanceConfig
    from robust6dof.simulation.outcome import Outcome
    from robust6dof.simulation.pose_source import PoseSource
    from robust6dof.simulation.scenario import Scenario


@dataclass(frozen=True)
class Options(CommonOptions):
    out: Path
    """Folder for the results."""
    scenario: str = "table"
    """table, moving, occlusion, leave-and-return or gust."""
    category: str = "any"
    """bottle, bowl, camera, can, laptop or mug; any draws one for each seed."""
    path: Literal["straight", "circle", "stop-and-go", "mixed"] | None = None
    """How the target of `moving` drives; drawn for each seed if not given."""
    speed: float | None = None
    """How fast it drives [m/s]; drawn between 0.1 and 0.5 if not given."""
    seeds: str | None = None
    """Runs to make: 7, or 0..19 (both included), or 1,4,9. Without it the one of --seed."""
    law: str = "coupled"
    """How errors become velocities: printed, coupled or feedforward (PAD-Servo), ibvs or pbvs.
    Several, as in coupled,feedforward, are flown from the same starts and compared."""
    poses: Literal["tracker", "truth"] = "tracker"
    """What the servo is fed: a tracker's poses from the rendered images, or the simulation's."""
    tracker: str = "robust6dof"
    """Which tracker."""
    arm: Path | None = None
    """URDF or MJCF of one's own arm of four joints, hanging, instead of the default one."""
    standoff: float = 0.5
    """Of the goal camera from the object [m]; it looks down on it."""
    goal_tilt_deg: float = 0.0
    """From straight down [deg], 0 to 60: the goal camera then sees the object from aside too."""
    goal: Path | None = None
    """File with the goal T_cam_obj (4×4 numbers) instead of the two before."""
    time_limit: float = 60.0
    """End of a run that does not arrive [s]."""
    latency_ms: float = 50.0
    """From the exposure of an image to its arrival at the tracker."""
    measured_delay: bool = False
    """Add the tracker's own computing time to the delay (a run then no longer repeats exactly)."""
    same_category_clutter: bool = False
    """Put objects of the target's own category beside it too."""
    video: bool = True
    """Write guidance.mp4."""
    plots: bool = True
    """Draw velocities.png and errors.png for each seed."""
    processes: int | None = None
    """Runs at a time; one for each core if not given."""


def run(options: Options) -> None:
    """Fly all seeds under every law; write their folders, campaign.json and, for several laws,
    laws.md."""
    from dataclasses import replace

    from robust6dof.simulation.comparison import law_table

    _check(options)
    _announce(options)
    laws = _laws(options)
    if len(laws) == 1:
        _campaign(options)
        return
    campaigns = {law: _campaign(replace(options, law=law, out=options.out / law)) for law in laws}
    table = law_table(campaigns)
    (options.out / "laws.md").write_text(table)
    print(table, end="")


def _campaign(options: Options) -> dict[str, Any]:
    """All seeds under one law; returns what campaign.json says of them."""
    import json
    import os

    from robust6dof.simulation.campaign import finished, parse_seeds, run_all, seed_folder
    from robust6dof.simulation.outcome import sum_up

    seeds = parse_seeds(options.seeds or str(options.seed))
    settings = _settings(options)
    done = {seed: finished(seed_folder(options.out, seed), settings) for seed in seeds}
    outcomes = [outcome for outcome in done.values() if outcome is not None]
    todo = [seed for seed in seeds if done[seed] is None]
    if outcomes:
        print(f"{len(outcomes)} finished runs of the same settings are kept")
    options.out.mkdir(parents=True, exist_ok=True)
    try:
        for outcome in run_all(
            partial(fly, options), todo, options.processes or os.cpu_count() or 1
        ):
            outcomes.append(outcome)
            print(line_of(outcome, len(outcomes), len(seeds)), flush=True)
    finally:
        campaign = sum_up(sorted(outcomes, key=lambda outcome: outcome.seed))
        if outcomes:
            text = json.dumps(settings | campaign, indent=1)
            (options.out / "campaign.json").write_text(text + "\n")
    report(campaign, options.out)
    return campaign


def fly(options: Options, seed: int) -> Outcome:
    """One seed: fly it, write its folder, return its outcome."""
    from contextlib import ExitStack

    from robust6dof.simulation.campaign import seed_folder, store
    from robust6dof.simulation.episode import EpisodeOptions
    from robust6dof.simulation.guidance import run_guidance
    from robust6dof.simulation.outcome import judge_run
    from robust6dof.simulation.start import draw_episode
    from robust6dof.visualization.guidance_plots import plot_errors, plot_velocities
    from robust6dof.visualization.guidance_video import GuidanceVideo

    manipulator, goal, config = _manipulator(options), _goal(options), _config(options)
    category = None if options.category == "any" else options.category
    drawn = EpisodeOptions(category, options.same_category_clutter)
    episode = draw_episode(_scenario(options), drawn, manipulator, goal, seed)
    folder = seed_folder(options.out, seed)
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        observers = []
        if options.video:
            name = "truth" if options.poses == "truth" else options.tracker
            video = GuidanceVideo(
                folder / "guidance.mp4",
                episode,
                manipulator,
                goal,
                title=name,
                truth=options.poses == "truth",
            )
            observers.append(stack.enter_context(video))
        poses = _pose_source(options, episode)
        flown = run_guidance(episode, manipulator, goal, poses, config, observers)
    outcome = judge_run(seed, episode.world.target.category, flown, config, manipulator.arm)
    flown.trace.write(folder / "trace.csv")
    if options.plots:
        plot_velocities(flown.trace, folder / "velocities.png")
        plot_errors(flown.trace, folder / "errors.png", config.servo.delta_R, config.servo.delta_T)
    store(folder, outcome, _settings(options))
    return outcome


def _check(options: Options) -> None:
    """Refuse what no run could use, before the first begins."""
    from robust6dof.baselines.registry import make_tracker
    from robust6dof.errors import InputError
    from robust6dof.frames import CATEGORIES
    from robust6dof.servo.config import LAWS

    if options.category not in ("any", *CATEGORIES):
        names = ", ".join(CATEGORIES)
        raise InputError(f"no category '{options.category}'; there is: any, {names}")
    if not options.time_limit > 0 or options.latency_ms < 0:
        raise InputError("--time-limit must be positive and --latency-ms at least 0")
    if options.poses == "tracker":
        make_tracker(options.tracker, "mug")
    for law in _laws(options):
        if law not in LAWS:
            raise InputError(f"no law '{law}'; there is: {', '.join(LAWS)}")
    if options.speed is not None and not 0 < options.speed <= 1:
        raise InputError(f"--speed must be over 0 and at most 1 m/s, got {options.speed}")
    _scenario(options)
    _check_reach(options)


def _laws(options: Options) -> list[str]:
    return list(dict.fromkeys(law.strip() for law in options.law.split(",")))


def _scenario(options: Options) -> Scenario:
    from dataclasses import replace

    from robust6dof.errors import InputError
    from robust6dof.simulation.scenario import scenario_named

    scenario = scenario_named(options.scenario)
    if options.path is None and options.speed is None:
        return scenario
    if scenario.motion != "mixed":
        raise InputError("--path and --speed are for --scenario moving")
    speed = scenario.speed if options.speed is None else (options.speed, options.speed)
    return replace(scenario, motion=options.path or scenario.motion, speed=speed)


def _manipulator(options: Options) -> AerialManipulator:
    from robust6dof.errors import DataError
    from robust6dof.robot.aerial_manipulator import (
        default_aerial_manipulator,
        read_aerial_manipulator,
    )

    if options.arm is None:
        return default_aerial_manipulator()
    manipulator = read_aerial_manipulator(options.arm)
    if len(manipulator.arm.joints) != 4:
        problem = f"the arm has {len(manipulator.arm.joints)} joints between base and camera"
        raise DataError(options.arm, problem, "The guidance is the paper's: it moves four")
    return manipulator


def _goal(options: Options) -> Any:
    from math import radians

    from robust6dof.servo.goal import look_down_goal, read_goal

    if options.goal:
        return read_goal(options.goal)
    return look_down_goal(options.standoff, tilt=radians(options.goal_tilt_deg))


def _check_reach(options: Options) -> None:
    """Refuse a goal that a hovering vehicle cannot hold."""
    from math import degrees

    from robust6dof.errors import InputError
    from robust6dof.robot.reachability import reach_goal

    reach = reach_goal(_manipulator(options), _goal(options))
    if not reach.reachable:
        raise InputError(
            f"the goal is out of the arm's reach: over an upright object a level vehicle stays "
            f"{degrees(reach.angle_off):.0f} degrees off this view; choose one that looks down"
        )


def _config(options: Options) -> GuidanceConfig:
    from robust6dof.servo.config import PadServoConfig
    from robust6dof.simulation.guidance import GuidanceConfig

    law = cast("Law", options.law)
    return GuidanceConfig(PadServoConfig(law=law), time_limit=options.time_limit)


def _pose_source(options: Options, episode: Episode) -> PoseSource:
    from robust6dof.baselines.registry import make_tracker
    from robust6dof.simulation.pose_source import TrackedPoses, TruePoses

    target, latency = episode.world.target, 1e-3 * options.latency_ms
    if options.poses == "truth":
        return TruePoses(target.extents, latency)
    tracker = make_tracker(
        options.tracker, target.category, seed=episode.seed, device=options.device, exact_start=True
    )
    return TrackedPoses(tracker, target.extents, latency, options.measured_delay)


def _settings(options: Options) -> dict[str, Any]:
    """All that decides a run's result, for campaign.json and to know a finished seed again."""
    from robust6dof import __version__

    keys = (
        "scenario category path speed law poses tracker standoff goal_tilt_deg goal time_limit "
        "latency_ms measured_delay same_category_clutter video plots"
    )
    settings = {key: getattr(options, key) for key in keys.split()}
    settings["arm"] = None if options.arm is None else options.arm.read_text()
    settings["goal"] = None if options.goal is None else _goal(options).tolist()
    settings["tracker"] = options.tracker if options.poses == "tracker" else None
    return settings | {"version": __version__}


def _announce(options: Options) -> None:
    if options.poses == "tracker":
        print(
            f"poses: tracker '{options.tracker}', started with the true pose, size and mask of "
            "the first frame (start hint: truth); it sees images only from then on"
        )
    else:
        print("poses: simulation truth (no tracker)")
