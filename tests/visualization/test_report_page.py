"""The page stands alone: what it shows is inside it, and text cannot break it."""

import base64
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from robust6dof.errors import DataError
from robust6dof.visualization.report_page import Section, write_report_page


def test_pictures_are_inside_and_text_is_escaped(tmp_path: Path) -> None:
    picture = tmp_path / "plot.png"
    cv2.imwrite(str(picture), np.zeros((4, 4, 3), np.uint8))
    section = Section("Error < 5°", "a & b", [("time [s]", "11.9")], [(picture, "the <plot>")])
    page = write_report_page(tmp_path / "new" / "index.html", "Run", [section]).read_text()
    (data,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert base64.b64decode(data) == picture.read_bytes()
    assert "Error &lt; 5°" in page
    assert "a &amp; b" in page
    assert "the &lt;plot&gt;" in page
    assert "http" not in page, "nothing is fetched"


def test_a_missing_or_unknown_picture_is_named(tmp_path: Path) -> None:
    for name, message in (("plot.png", "missing"), ("plot.exe", "cannot be shown")):
        with pytest.raises(DataError, match=message):
            write_report_page(
                tmp_path / "index.html", "Run", [Section("x", media=[(tmp_path / name, "")])]
            )
