"""A self-contained page: text, tables, pictures and videos in one HTML file."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from robust6dof.errors import DataError

_MEDIA = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".svg": "image/svg+xml",
    ".mp4": "video/mp4",
}

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
       color: #1c2330; background: #fcfcfd; }
h1 { font-size: 1.6rem } h2 { font-size: 1.15rem; margin-top: 2rem }
img, video { max-width: 100%; border: 1px solid #d8dce4; border-radius: 4px }
table { border-collapse: collapse; margin: .6rem 0 } td { padding: .15rem .9rem .15rem 0 }
td + td { font-variant-numeric: tabular-nums } figcaption { color: #596273; font-size: .9rem }
figure { margin: .8rem 0 }
"""


@dataclass(frozen=True)
class Section:
    """One part of the page."""

    heading: str
    text: str = ""
    rows: Sequence[tuple[str, str]] = field(default=())
    """A two-column table: what, how much."""
    media: Sequence[tuple[Path, str]] = field(default=())
    """Pictures (.png, .jpg, .svg) and videos (.mp4) with their captions."""


def write_report_page(path: str | Path, title: str, sections: Sequence[Section]) -> Path:
    """Write the page; pictures and videos are embedded. Returns its path.

    Raises:
        DataError: a picture is missing or of another kind.
    """
    body = "\n".join(_section(section) for section in sections)
    page = (
        f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>\n'
        f"<style>{_STYLE}</style>\n<h1>{escape(title)}</h1>\n{body}\n</html>\n"
    )
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding="utf-8")
    return path


def _section(section: Section) -> str:
    parts = [f"<h2>{escape(section.heading)}</h2>"]
    if section.text:
        parts.append(f"<p>{escape(section.text)}</p>")
    if section.rows:
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>"
            for name, value in section.rows
        )
        parts.append(f"<table>{rows}</table>")
    parts += [_figure(Path(file), caption) for file, caption in section.media]
    return "\n".join(parts)


def _figure(file: Path, caption: str) -> str:
    if file.suffix not in _MEDIA:
        raise DataError(file, "this kind of file cannot be shown", f"Give one of {list(_MEDIA)}")
    if not file.is_file():
        raise DataError(file, "the picture is missing", "Make it before the page")
    data = base64.b64encode(file.read_bytes()).decode("ascii")
    source = f"data:{_MEDIA[file.suffix]};base64,{data}"
    if file.suffix == ".mp4":
        shown = f'<video src="{source}" controls muted loop playsinline></video>'
    else:
        shown = f'<img src="{source}" alt="{escape(caption)}">'
    return f"<figure>{shown}<figcaption>{escape(caption)}</figcaption></figure>"
