"""The root of an arm's file, URDF or MJCF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from robust6dof.errors import DataError


def read_xml_root(path: Path, wanted: str) -> ET.Element:
    """Parse the file.

    Args:
        path: the file.
        wanted: what to give instead of one that is no XML, such as "a URDF file".

    Raises:
        DataError: unreadable XML.
    """
    try:
        return ET.parse(path).getroot()
    except (OSError, ET.ParseError) as problem:
        raise DataError(path, f"not readable as XML ({problem})", f"Give {wanted}") from None
