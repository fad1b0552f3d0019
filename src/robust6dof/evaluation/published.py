"""Published figures to print beside ours, as their papers give them, and what to mind about them.

From the robust6dof paper unless another source is named.
"""

from __future__ import annotations

from dataclasses import dataclass

from robust6dof.evaluation.scores import Row


@dataclass(frozen=True)
class Published:
    """One method's line on one benchmark."""

    method: str
    figures: Row
    remark: str = ""

    def beside(self, comparable: bool) -> str:
        """What to say of it beside figures of ours; they compare where ours are of real images."""
        where = "published" if comparable else "published, real images: NOT comparable"
        return "; ".join(part for part in (where, self.remark) if part)


def _pose(five_two: float, five_five: float, ten_two: float, ten_five: float) -> Row:
    return {"5deg2cm": five_two, "5deg5cm": five_five, "10deg2cm": ten_two, "10deg5cm": ten_five}


def _tracking(five_five: float, iou25: float, R_err_deg: float, T_err_cm: float) -> Row:
    return {"5deg5cm": five_five, "IoU25": iou25, "R_err_deg": R_err_deg, "T_err_cm": T_err_cm}


def _auc(add: float, add_s: float) -> Row:
    return {"ADD_auc": add, "ADDS_auc": add_s}


_NAN = float("nan")
_PAPER = "Robust6DoF (paper)"

PUBLISHED: dict[str, tuple[Published, ...]] = {
    "6pack": (
        Published(_PAPER, _tracking(70.6, 89.8, 5.2, 3.0)),
        Published("BundleTrack", _tracking(87.4, 99.9, 2.4, 2.1), "left out of the paper's table"),
    ),
    "nocs-map": (
        Published(_PAPER, _pose(57.1, 70.6, 75.2, 84.5)),
        Published("ComPose", _pose(62.1, _NAN, 81.8, _NAN)),
        Published("CleanPose", _pose(61.7, 67.6, 78.3, 86.3)),
    ),
    "ycbv-auc": (
        Published(_PAPER, _auc(83.4, 85.6), "unweighted mean of the objects"),
        Published("PoseCNN", _auc(53.7, 75.9), "its paper; pooled over all pairs"),
        Published("PoseCNN + ICP", _auc(79.3, 93.0), "its paper; pooled over all pairs"),
        Published("se(3)-TrackNet", _auc(93.0, 95.7), "CAD model of the object"),
        Published("FoundationPose", _auc(96.0, 97.9), "CAD model of the object"),
        Published("FoundationPose", _auc(93.7, 97.5), "model-free, reference views"),
    ),
    "ycbineoat-auc": (
        Published(_PAPER, _auc(85.4, 90.2)),
        Published("BundleTrack", _auc(87.3, 92.5)),
        Published("BundleSDF", _auc(87.0, 93.8)),
        Published("FoundationPose", _auc(93.1, 96.4)),
    ),
    "wild6d": (
        Published(_PAPER, {"IoU50": 75.1, "5deg2cm": 31.2, "5deg5cm": 44.4, "10deg5cm": 50.9}),
    ),
}

CAVEATS: dict[str, tuple[str, ...]] = {
    "6pack": (
        "The paper's \"IoU25\" row holds IoU25 under this protocol in some columns and CAPTRA's "
        "mean IoU in others; it prints 89.8 in one table and 89.9 in another.",
        "The paper's mAP table and its tracking table carry the same 89.8 and 70.6.",
        "Errors are averaged only over frames with IoU above 0.25, under an IoU that tolerates "
        "20 cm: a tracker that loses the object is not punished by them.",
    ),
    "6pack-fixed": ("Not comparable with published tables, which have the benchmark's bugs.",),
    "captra": (
        "CAPTRA's tables print mean IoU (here mean_IoU), which others quote as IoU25.",
        "On NOCS the truth is fitted anew to the coordinate maps and differs a little.",
    ),
    "nocs-map": (
        "The paper's mAP table and its tracking table carry the same 89.8 and 70.6.",
        "Published figures rest on shared Mask R-CNN detections; ours must name theirs.",
    ),
    "ycbv-auc": (
        "The paper prints ADD above ADD-S for some objects (cracker box 92.1/91.7, mustard "
        "91.4/90.3), which the definitions make impossible.",
        'Its "Average" is the unweighted mean of the objects for its own rows and CatTrack\'s, '
        "but pooled for PoseCNN's. Both are given here.",
        'It says "fine-tuned on YCB-Video" in the set-up and "without fine-tuning" in the results.',
    ),
    "ycbineoat-auc": ("Trackers with a CAD model and without one are not the same contest.",),
    "wild6d": ("True masks serve as detections, and every score is 1.",),
    "aerial": ("This project's own protocol: nothing published compares with it.",),
}
