"""H.264 videos that a browser plays, through PyAV's own codec library."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType

import numpy as np
from jaxtyping import UInt8

from robust6dof.errors import InputError


class VideoWriter:
    """Write RGB frames to an MP4; use it as a context manager.

    The first frame sets the size; odd sizes lose their last row or column (the codec needs even).

    Raises:
        InputError: a later frame of another size.
    """

    def __init__(self, path: str | Path, fps: float = 20.0) -> None:
        import av

        Path(path).parent.mkdir(parents=True, exist_ok=True)
        self._container = av.open(str(path), mode="w", options={"movflags": "faststart"})
        self._fps = Fraction(fps).limit_denominator(1000)
        self._stream = None

    def write(self, rgb: UInt8[np.ndarray, "H W 3"]) -> None:
        """Append one frame."""
        import av

        height, width = rgb.shape[0] // 2 * 2, rgb.shape[1] // 2 * 2
        if self._stream is None:
            self._stream = self._open_stream(width, height)
        if (width, height) != (self._stream.width, self._stream.height):
            raise InputError(
                f"the video is {self._stream.width}×{self._stream.height}, "
                f"this frame {width}×{height}"
            )
        picture = np.ascontiguousarray(rgb[:height, :width])
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def close(self) -> None:
        """Flush and finish the file."""
        if self._stream is not None:
            for packet in self._stream.encode():
                self._container.mux(packet)
        self._container.close()

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _open_stream(self, width: int, height: int):
        stream = self._container.add_stream("libx264", rate=self._fps)
        stream.width, stream.height = width, height
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "23", "preset": "veryfast"}
        stream.thread_count = 1
        return stream
