"""Score stored poses, ours or other people's, under a named protocol."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from robust6dof.cli.options import CommonOptions

ProtocolName = Literal[
    "aerial",
    "nocs-map",
    "6pack",
    "6pack-fixed",
    "captra",
    "ycbv-auc",
    "ycbineoat-auc",
    "wild6d",
]


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    path: Annotated[Path, tyro.conf.Positional]
    """A run of `robust6dof predict`, or others' poses: ICG's zip, a folder of NOCS result pickles,
    of 6-PACK's text or of ob_in_cam files, a BOP csv."""
    protocol: ProtocolName
    """How the poses are scored."""
    out: Path
    """Folder for scores.json, table.md and the plots."""
    data: Path | None = None
    """The data set with the truth (default: the one a run was made on)."""
    sequences: tuple[str, ...] = ()
    """Score only these (default: all of the data set; what a run lacks counts as missing)."""
    method: str | None = None
    """Which method of a pack (default: every one); otherwise a name for the tracker."""
    format: Literal["run", "icg", "nocs", "6pack", "ob_in_cam", "bop"] | None = None
    """Format of the poses (default: recognised)."""
    models: Path | None = None
    """Model points for ADD and ADD-S (default: models_points or models beside the poses or in
    the data set)."""
    point_stride: int | None = None
    """Measure ADD and ADD-S with each n-th model point (default: all; each third for ICG's zip,
    whose check figures are those). Fewer points are faster and give a lower AUC of ADD-S."""
    align_first: bool = False
    """Right-multiply each track so that its first pose is the truth (model-free trackers)."""
    export: Literal["nocs", "6pack", "ob_in_cam", "bop"] | None = None
    """Also write the poses in this format, for others' evaluators."""


def run(options: Options) -> None:
    """Score, write the files, print the table."""
    from robust6dof.evaluation.evaluate import default_models, read_stored, score_stored
    from robust6dof.evaluation.protocols import find_protocol
    from robust6dof.evaluation.report import markdown, write_report
    from robust6dof.evaluation.result_formats import export_records

    protocol = find_protocol(options.protocol)
    models = options.models or default_models(options.path, options.data)
    scores = []
    for stored in read_stored(
        options.path,
        protocol,
        options.data,
        options.method,
        options.format,
        options.sequences,
    ):
        scores.append(
            score_stored(stored, protocol, models, options.point_stride, options.align_first)
        )
        if options.export:
            export_records(options.export, options.out / "export" / stored.tracker, stored.records)
    written = write_report(options.out, scores)
    print(markdown(scores))
    print("\n".join(f"written: {path}" for path in written))
