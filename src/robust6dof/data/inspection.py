"""What is on disk and whether it makes sense: the findings that `robust6dof doctor` prints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool

from robust6dof.data.calibration import fit_intrinsics
from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.data.depth_unit import check_depth_unit
from robust6dof.data.other_folders import loose_images, other_contents
from robust6dof.data.pose_check import pose_problem
from robust6dof.data.recognition import open_dataset, recognise
from robust6dof.data.recordings import RecordingSequence
from robust6dof.errors import DataError
from robust6dof.frames import RgbdFrame

FIELD_OF_VIEW_DEG = (20.0, 120.0)
"""Horizontal fields of view that RGB-D cameras have."""
LEAST_VALID_DEPTH = 0.2
"""Share of pixels with depth below which a frame is remarked upon."""


@dataclass(frozen=True)
class Finding:
    """One thing seen."""

    level: Literal["ok", "note", "problem"]
    text: str


@dataclass(frozen=True, eq=False)
class Sample:
    """One frame that was looked at, with its truth."""

    label: str
    frame: RgbdFrame
    truths: tuple[ObjectTruth, ...]
    missing: tuple[str, ...] = ()
    """What the layout foresees and this frame lacks."""


@dataclass
class Inspection:
    """All that was found out about a folder."""

    path: Path
    kind: str = "unknown"
    findings: list[Finding] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)

    @property
    def problems(self) -> int:
        return sum(finding.level == "problem" for finding in self.findings)

    def add(self, level: Literal["ok", "note", "problem"], text: str) -> None:
        finding = Finding(level, text)
        if finding not in self.findings:
            self.findings.append(finding)


def inspect_folder(
    path: str | Path, count: int = 8, open_folder: Callable[[Path], Dataset] = open_dataset
) -> Inspection:
    """Open a folder, look at `count` frames spread over it, and say what is amiss.

    Never raises for what is on disk: that is what it reports.

    Args:
        path: a recording or a data set.
        count: how many frames to look at.
        open_folder: how to open it, where `open_dataset` has to be told more.
    """
    inspection = Inspection(Path(path))
    try:
        inspection.kind = recognise(path)
        dataset = open_folder(inspection.path)
    except DataError as error:
        _judge_other_folder(inspection, error)
        return inspection
    frames = sum(len(sequence) for sequence in dataset.sequences)
    inspection.kind = dataset.name
    inspection.add("ok", f"{dataset.name}: {len(dataset.sequences)} sequences, {frames} frames")
    for sequence, index in _spread(dataset, count):
        _read_sample(inspection, sequence, index)
    _judge_frames(inspection)
    _judge_truth(inspection)
    _judge_layout(inspection, dataset)
    return inspection


def _judge_other_folder(inspection: Inspection, error: DataError) -> None:
    """A folder without images: meshes and stored poses are no mistake, anything else is."""
    path = inspection.path
    contents = list(other_contents(path)) if path.is_dir() else []
    if contents:
        inspection.kind = "no images"
        inspection.add("note", f"{path.name}: no recording or data set of images, but it holds")
    else:
        inspection.add("problem", str(error))
    for sound, text in contents:
        inspection.add("ok" if sound else "problem", text)
    if path.is_dir():
        known = _known_folders(path)
        loose = "" if known else loose_images(path)
        for text in filter(None, (loose, _kinds_of_files(path), known)):
            inspection.add("note", text)


def _spread(dataset: Dataset, count: int) -> Iterator[tuple[DatasetSequence, int]]:
    """Frames at equal distances over all sequences, the first and the last among them."""
    places = [(s, i) for s in dataset.sequences for i in range(len(s))]
    for place in np.unique(np.linspace(0, len(places) - 1, count).round().astype(int)):
        yield places[place]


def _read_sample(inspection: Inspection, sequence: DatasetSequence, index: int) -> None:
    label = f"{sequence.name}/{sequence.frame_names[index]}"
    try:
        frame = sequence.frame(index)
    except DataError as error:
        inspection.add("problem", str(error))
        return
    try:
        truths = sequence.truth(index)
    except DataError as error:
        inspection.add("problem", str(error))
        truths = ()
    inspection.samples.append(Sample(label, frame, truths, sequence.missing(index)))


def _judge_frames(inspection: Inspection) -> None:
    if not inspection.samples:
        return
    near, far, share = [], [], []
    for sample in inspection.samples:
        depth, place = sample.frame.depth, inspection.path / sample.label
        valid = depth[depth > 0]
        share.append(valid.size / depth.size)
        if valid.size:
            near.append(np.quantile(valid, 0.1))
            far.append(np.quantile(valid, 0.9))
        try:
            check_depth_unit(depth, 0.001, place)
            size = (sample.frame.width, sample.frame.height)
            fit_intrinsics(sample.frame.K, size, place)
        except DataError as error:
            inspection.add("problem", str(error))
    if not near:
        inspection.add("problem", f"no depth at all in {len(share)} frames looked at")
        return
    level = "ok" if min(share) > LEAST_VALID_DEPTH else "note"
    inspection.add(
        level,
        f"depth: most of it between {min(near):.2f} and {max(far):.2f} m; "
        f"{min(share):.0%} to {max(share):.0%} of the pixels have it",
    )
    _judge_camera(inspection, inspection.samples[0].frame)


def _judge_camera(inspection: Inspection, frame: RgbdFrame) -> None:
    angle_deg = float(np.degrees(2 * np.arctan(frame.width / 2 / frame.K[0, 0])))
    usual = FIELD_OF_VIEW_DEG[0] < angle_deg < FIELD_OF_VIEW_DEG[1]
    inspection.add(
        "ok" if usual else "problem",
        f"intrinsics: {frame.width}×{frame.height}, fx {frame.K[0, 0]:.1f} fy "
        f"{frame.K[1, 1]:.1f} cx {frame.K[0, 2]:.1f} cy {frame.K[1, 2]:.1f}: "
        f"{angle_deg:.0f}° wide" + ("" if usual else ", which no RGB-D camera is"),
    )


def _judge_truth(inspection: Inspection) -> None:
    samples = inspection.samples
    truths = [(sample, truth) for sample in samples for truth in sample.truths]
    if not samples:
        return
    annotated = sum(bool(sample.truths) for sample in samples)
    names = sorted({truth.name for _, truth in truths})
    inspection.add(
        "ok" if annotated == len(samples) else "note",
        f"annotated: {annotated} of {len(samples)} frames looked at"
        + (f" ({', '.join(names)})" if names else "; nothing to score against"),
    )
    if not truths:
        return
    unsized = sorted({truth.name for _, truth in truths if truth.extents is None})
    if unsized:
        remedy = " (--models names the models' folder)" if _is_ycb_video(inspection) else ""
        text = f"size unknown: {', '.join(unsized)}; IoU cannot be scored{remedy}"
        inspection.add("note", text)
    bad = [text for sample, truth in truths if (text := _object_problem(sample, truth))]
    for text in bad:
        inspection.add("problem", text)
    if not bad:
        inspection.add("ok", f"masks and poses agree with the depth ({len(truths)} objects)")


def _object_problem(sample: Sample, truth: ObjectTruth) -> str | None:
    problem = None if truth.mask is None else _mask_problem(sample.frame, truth.mask)
    problem = f"{truth.name}: {problem}" if problem else pose_problem(sample.frame, truth)
    return f"{sample.label}: {problem}" if problem else None


def _mask_problem(frame: RgbdFrame, mask: Bool[np.ndarray, "H W"]) -> str | None:
    if not mask.any():
        return "its mask is empty"
    if mask.mean() > 0.8:
        return f"its mask covers {mask.mean():.0%} of the image: is it inverted?"
    if not (frame.depth[mask] > 0).any():
        return "there is no depth in its mask"
    return None


def _judge_layout(inspection: Inspection, dataset: Dataset) -> None:
    """What this copy lacks, in the frames looked at, and whether colour fits the depth."""
    lacking = Counter(part for sample in inspection.samples for part in sample.missing)
    for count in sorted(set(lacking.values()), reverse=True):
        parts = ", ".join(part for part, times in lacking.items() if times == count)
        inspection.add("note", f"missing in {count} of {len(inspection.samples)} frames: {parts}")
    if _is_ycb_video(inspection):
        for stray in _unnumbered_videos(dataset.path):
            inspection.add("note", f"{stray} holds frames too, but is no video's number: left out")
    videos = [s.video for s in dataset.sequences if isinstance(s, RecordingSequence)]
    if any(video.layout == "tsdf-fusion" and not video.depth_only for video in videos):
        inspection.add(
            "note",
            "raw Kinect recordings (7-Scenes) are not registered: compare the two pictures, and "
            "use depth_only where edges differ",
        )


def _is_ycb_video(inspection: Inspection) -> bool:
    return inspection.kind.startswith("ycb-video")


def _unnumbered_videos(path: Path) -> list[str]:
    folders = [child for root in (path, path / "data") if root.is_dir() for child in root.iterdir()]
    return sorted(f.name for f in folders if not f.name.isdigit() and any(f.glob("*-color.png")))


def _kinds_of_files(path: Path) -> str:
    suffixes = Counter(file.suffix.lower() for file in path.rglob("*") if file.is_file())
    kinds = ", ".join(f"{n} {suffix or 'without suffix'}" for suffix, n in suffixes.most_common(6))
    return f"it holds {kinds}" if kinds else "it is empty"


def _known_folders(path: Path) -> str:
    """Which subfolders are recordings or data sets; empty where none is."""
    known = []
    for folder in sorted(child for child in path.iterdir() if child.is_dir()):
        try:
            known.append(f"{folder.name} ({recognise(folder)})")
        except DataError:
            continue
    return f"look into {', '.join(known)}" if known else ""
