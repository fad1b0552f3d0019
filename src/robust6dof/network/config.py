"""What the network is made of: sizes, and a switch for every part of the paper."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

from robust6dof.errors import InputError


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes and switches of the network; the defaults are the paper's.

    Raises:
        InputError: sizes that do not fit together.
    """

    points: int = 2048
    """N: observed points (and their pixels) per frame."""
    prior_points: int = 2048
    """N_r: points of the categorical shape prior."""
    keypoints: int = 512
    """n: keypoints per frame."""
    width: int = 128
    """d: width of all point features."""
    heads: int = 2
    """h: heads of each multi-head attention; divides `width`. The paper gives no number."""
    rank: int = 64
    """k: what the low-rank attention contracts the N keys to."""
    plane_width: int = 64
    """d_T: width of each of the three feature planes."""
    ffn_ratio: int = 2
    """Hidden width of the feed-forward layers over `width`."""
    crop_px: int = 192
    """Side of the square colour crop."""
    pixel_stem: Literal["cnn", "rgb"] = "cnn"
    """Colour features before fusion: a small CNN over the crop, or each pixel's own RGB."""
    pixel_widths: tuple[int, ...] = (32, 64, 128, 192)
    """Channels of the CNN: the first two layers halve the resolution, the others keep it."""
    weight_shared_attention: bool = True
    """WSA (Eq. wsa-1/2); off: the modalities go on unfused."""
    dense_fusion: Literal["separate", "shared", "off"] = "separate"
    """Low-rank attention (Eq. msa-1): X_c and Y_c with separate or shared weights; off: the
    classical multi-head attention over the sum of both modalities."""
    contraction: Literal["average", "printed"] = "average"
    """X_c and Y_c of every low-rank attention: a softmax over the N points, so that nothing grows
    with N; or the bare projections, as printed."""
    fusion_residual: bool = True
    """Add the point features to the low-rank attention's output, and normalise. Off as printed."""
    similarity: Literal["scaled", "printed"] = "scaled"
    """Similarity maps from inner products over √d, or from bare ones as printed."""
    temporal_encoder: bool = True
    """STE; off: F_temp = F_obj."""
    shape_filter: Literal["weighted-sum", "max", "off"] = "weighted-sum"
    """SSF: the prior's features and coordinates as a weighted sum, or as a maximum over j; off:
    the similarity to the prior serves the keypoints alone."""
    augmentation_decoder: bool = True
    """AD; off: F_aug is the shape filter's output, or F_temp without it."""
    keypoint_source: Literal["prior", "learned", "unsupervised"] = "prior"
    """What asks for the keypoints: points of the prior; n learned queries (no prior guidance); or
    coordinates regressed from one pooled feature, as in 6-PACK."""
    structure_bias: bool = True
    """With `prior` keypoints: M also prefers points whose canonical coordinate is near."""
    foreground: bool = True
    """Estimate which points lie on the object, and keep M and the anchor to these."""
    fine_matching: bool = True
    """Dual softmax and mutual nearest neighbours; off: equal indices are the pairs."""
    match_temperature: float = 0.1
    """τ of the score matrix (on unit features)."""
    match_threshold: float = 0.45
    """θ_c: least matching probability of a fine match."""
    canonical_anchor: bool = True
    """Predict a canonical coordinate for each point and keypoint: the absolute similarity."""
    pose_correction: bool = False
    """Within the anchor: one affine correction of the predicted frame for all points of a view,
    from a pooled feature. The presets have it."""

    def __post_init__(self) -> None:
        if self.width % self.heads:
            raise InputError(f"width {self.width} must be a multiple of heads {self.heads}")
        if self.keypoint_source == "prior" and self.keypoints > self.prior_points:
            raise InputError(
                f"{self.keypoints} keypoints cannot each have a point of a prior of "
                f"{self.prior_points}; raise prior_points"
            )

    def to_json(self) -> str:
        """As JSON text, stored beside the weights."""
        return json.dumps(asdict(self), indent=2)

    @classmethod
    def from_json(cls, text: str) -> NetworkConfig:
        """Back from `to_json`.

        Raises:
            InputError: not JSON, or keys that this version does not know.
        """
        try:
            values: dict[str, Any] = json.loads(text)
        except json.JSONDecodeError as error:
            raise InputError(f"the network's configuration is not JSON: {error}") from error
        unknown = set(values) - {field.name for field in fields(cls)}
        if unknown:
            raise InputError(f"unknown network settings {sorted(unknown)}: made by another version")
        if "pixel_widths" in values:
            values["pixel_widths"] = tuple(values["pixel_widths"])
        return cls(**values)


PRESETS: dict[str, NetworkConfig] = {
    "paper": NetworkConfig(pose_correction=True),
    "small": NetworkConfig(
        points=256,
        prior_points=256,
        keypoints=64,
        width=96,
        rank=32,
        plane_width=32,
        crop_px=96,
        pixel_widths=(16, 32, 48),
        pose_correction=True,
    ),
    "tiny": NetworkConfig(
        points=48,
        prior_points=40,
        keypoints=16,
        width=32,
        rank=8,
        plane_width=8,
        crop_px=24,
        pixel_widths=(8, 8),
        pose_correction=True,
    ),
}
"""`paper`: the paper's sizes. `small`: real time on two CPU cores. `tiny`: for tests."""


def preset(name: str) -> NetworkConfig:
    """A preset by name.

    Raises:
        InputError: no such preset.
    """
    if name not in PRESETS:
        raise InputError(f"no preset '{name}'; there is: {', '.join(PRESETS)}")
    return PRESETS[name]


_COMPONENTS: dict[str, dict[str, Any]] = {
    "M0": {"weight_shared_attention": False, "dense_fusion": "off", "temporal_encoder": False},
    "M1": {"dense_fusion": "off", "temporal_encoder": False},
    "M2": {"temporal_encoder": False},
    "M3": {},
    "M4": {},
    "M5": {},
}
_NO_DECODER = {"augmentation_decoder": False}
_ABLATIONS: dict[str, dict[str, Any]] = {
    **{
        name: {**parts, "shape_filter": "off", **_NO_DECODER}
        for name, parts in _COMPONENTS.items()
        if name in ("M0", "M1", "M2", "M3")
    },
    "M4": _NO_DECODER,
    "M5": {},
    "no-prior-guidance": {"keypoint_source": "learned"},
    "no-finer-matching": {"fine_matching": False},
    "unsupervised-keypoints": {"keypoint_source": "unsupervised"},
}


def ablation(name: str, base: NetworkConfig) -> NetworkConfig:
    """A row of the paper's ablation tables: M0 to M5 and the keypoint manners.

    `no-prior-guidance` and `unsupervised-keypoints` also need the auxiliary loss set to "off" and
    "separation" in the loss configuration.

    Raises:
        InputError: no such row.
    """
    if name not in _ABLATIONS:
        raise InputError(f"no ablation '{name}'; there is: {', '.join(_ABLATIONS)}")
    return replace(base, **_ABLATIONS[name])
