"""Where a lost object may be: the pieces of the whole image that could be it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import make_transform
from robust6dof.solver.absolute import AbsoluteFit
from robust6dof.tracking.disagreement import Disagreement
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.segmentation import DepthClusters, Segment, Segmenter


@dataclass(frozen=True)
class RecoveryConfig:
    """How a lost object is looked for."""

    guesses_per_frame: int = 3
    """Tried on each frame; the next frame goes on with the next ones."""
    turns: int = 8
    """About the up axis, evenly spread, of an object with a front."""
    turn_odds: float = 0.15
    """A piece is tried in its next turn before another one that is less likely by this."""
    passes: int = 2
    """Looks of the network from each guess."""
    size_ratio: tuple[float, float] = (0.35, 1.5)
    """Diagonal of a piece, which shows one side alone, over that of the object's box."""
    trust: float = 0.75
    """Confidence of the registration from which a thing may be the lost object."""
    color_gap: float = 0.05
    """Colours that differ by this share of the range are as unlikely as a confidence that is lower
    by the factor e."""
    stays: float = 0.1
    """What registration holds is left only for what is more likely by this (logarithm)."""
    same_color: float = 0.15
    """A piece whose mean colour differs by this share of the range is as unlikely as one whose
    diagonal differs by the factor e."""
    same_size: float = 0.25
    """A thing whose scale seems to differ by more (logarithm) is another one."""
    segmenter: Segmenter = field(default_factory=DepthClusters)


def poses_to_try(
    frame: RgbdFrame,
    T_cam_last: Float[np.ndarray, "4 4"],
    scale: float,
    color: Float[np.ndarray, "3"],
    symmetric: bool,
    config: RecoveryConfig,
) -> list[Float[np.ndarray, "4 4"]]:
    """Guesses of `T_cam_obj`, the pieces nearest in size and colour first.

    On each piece: the last orientation, its up axis turned to the normal of the plane that the
    piece stands on; and for objects with a front the turns from there.

    Args:
        frame: the image.
        T_cam_last: where the object was last believed to be.
        scale: diagonal of its box [m].
        color: its mean red, green, blue, 0 to 255; NaN where not known.
        symmetric: a turn about its y axis cannot be seen.
        config: sizes.
    """
    sized = []
    for segment in config.segmenter.segment(frame):
        points, _ = backproject(frame.depth, frame.K, segment.mask)
        low, high = np.percentile(points, [3, 97], axis=0)
        ratio = float(np.linalg.norm(high - low)) / scale
        if config.size_ratio[0] < ratio < config.size_ratio[1]:
            unlike = float(np.abs(frame.rgb[segment.mask].mean(axis=0) - color).mean()) / 255.0
            odds = abs(np.log(ratio / 0.8)) + np.nan_to_num(unlike) / config.same_color
            sized.append((odds, segment, (low + high) / 2))
    tries = [
        (odds + config.turn_odds * number, segment, centre, turn)
        for odds, segment, centre in sized
        for number, turn in enumerate(_turns_deg(1 if symmetric else config.turns))
    ]
    return [
        make_transform(_upright(T_cam_last[:3, :3], segment, turn), centre)
        for _, segment, centre, turn in sorted(tries, key=lambda one: one[0])
    ]


def other_turns(
    T_cam_obj: Float[np.ndarray, "4 4"], config: RecoveryConfig
) -> list[Float[np.ndarray, "4 4"]]:
    """The pose turned about the object's up axis, by little first."""
    turns = Rotation.from_euler("y", np.array(_turns_deg(config.turns)[1:])[:, None], degrees=True)
    return [T_cam_obj @ make_transform(R, np.zeros(3)) for R in turns.as_matrix()]


def _turns_deg(count: int) -> list[float]:
    """Evenly spread: none first, then the small ones to both sides."""
    return sorted((360.0 * i / count for i in range(count)), key=lambda turn: min(turn, 360 - turn))


def seen_poses(
    encoder: ViewEncoder,
    frame: RgbdFrame,
    guesses: Sequence[Float[np.ndarray, "4 4"]],
    extents: Float[np.ndarray, "3"],
    number: int,
    config: RecoveryConfig,
) -> list[Float[np.ndarray, "4 4"]]:
    """What the network makes of one share of the guesses; those of the wrong size go.

    Args:
        encoder: the network.
        frame: the image.
        guesses: all of them; `number` says whose turn it is.
        extents: of the object's box [m].
        number: which share; and of the points drawn.
        config: how many.
    """
    count, scale = min(config.guesses_per_frame, len(guesses)), float(np.linalg.norm(extents))
    turn = [guesses[(number * count + i) % len(guesses)] for i in range(count)]
    found = []
    for T_cam_obj in turn:
        seen = 0.0
        for _ in range(config.passes):
            features = encoder.encode(frame, T_cam_obj, extents, None, number)
            if features is None:
                break
            anchor = encoder.anchor(features, number)
            T_cam_obj, seen = anchor.T_cam_obj, anchor.scale
        if abs(np.log(max(seen, 1e-6) / scale)) < config.same_size:
            found.append(T_cam_obj)
    return found


def is_same_pose(
    anchor: AbsoluteFit,
    T_cam_obj: Float[np.ndarray, "4 4"],
    scale: float,
    symmetric: bool,
    angle: float = np.deg2rad(25.0),
    gap_share: float = 0.2,
    growth: float = 0.25,
) -> bool:
    """Whether one view's own pose and scale [m] are near these, as far as single views can tell."""
    apart = Disagreement.between(T_cam_obj, scale, anchor.T_cam_obj, anchor.scale, symmetric)
    near = apart.rotation < angle and apart.translation < gap_share * scale
    return bool(near and abs(apart.log_scale) < growth)


def _upright(
    R_cam_obj: Float[np.ndarray, "3 3"], segment: Segment, turn_deg: float
) -> Float[np.ndarray, "3 3"]:
    turned = R_cam_obj @ Rotation.from_euler("y", turn_deg, degrees=True).as_matrix()
    if segment.plane is None:
        return turned
    up = segment.plane.normal
    return Rotation.align_vectors(up[None], turned[:, 1][None])[0].as_matrix() @ turned
