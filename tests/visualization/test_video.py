"""Videos hold what was written, as H.264 with yuv420p: what every browser plays."""

from pathlib import Path

import av
import numpy as np
import pytest

from robust6dof.errors import InputError
from robust6dof.visualization.video import VideoWriter


def test_frames_come_back(tmp_path: Path) -> None:
    frames = [np.full((64, 97, 3), 40 * i, np.uint8) for i in range(5)]
    with VideoWriter(tmp_path / "new" / "video.mp4", fps=20) as video:
        for frame in frames:
            video.write(frame)
    with av.open(str(tmp_path / "new" / "video.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.average_rate == 20
        decoded = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(decoded) == 5
    assert decoded[0].shape == (64, 96, 3)
    for frame, back in zip(frames, decoded, strict=True):
        assert abs(float(frame.mean()) - float(back.mean())) < 6


def test_a_frame_of_another_size_is_refused(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "video.mp4") as video:
        video.write(np.zeros((32, 32, 3), np.uint8))
        with pytest.raises(InputError, match="32×32"):
            video.write(np.zeros((64, 32, 3), np.uint8))
