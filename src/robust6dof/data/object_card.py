"""`object.json`: what a recording in the de-facto layout is of, where its maker says so."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from robust6dof.errors import DataError

FILE_NAME = "object.json"


@dataclass(frozen=True)
class ObjectCard:
    """The object of a recording."""

    name: str
    category: str
    extents_m: tuple[float, float, float] | None = None
    """Side lengths of its box, which is centred on the object frame [m]."""
    handle_visible: dict[str, bool] = field(default_factory=dict)
    """By frame name, where a mug's handle may hide; a frame that is not listed shows it."""
    visible_fraction: dict[str, float] = field(default_factory=dict)
    """By frame name: share of the silhouette in view, 0 to 1."""


def write_object_card(folder: str | Path, card: ObjectCard) -> None:
    """Write `object.json` into a recording's folder."""
    (Path(folder) / FILE_NAME).write_text(json.dumps(asdict(card), indent=1) + "\n")


def read_object_card(folder: str | Path) -> ObjectCard | None:
    """Read `object.json`; None where there is none.

    Raises:
        DataError: it is not such a card.
    """
    path = Path(folder) / FILE_NAME
    if not path.is_file():
        return None
    try:
        fields: dict[str, Any] = json.loads(path.read_text())
        extents = fields.pop("extents_m", None)
        if extents is not None:
            x, y, z = (float(extent) for extent in extents)
            extents = (x, y, z)
        return ObjectCard(**fields, extents_m=extents)
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(
            path, f"not a description of an object ({error})", "Write name, category, extents_m"
        ) from error
