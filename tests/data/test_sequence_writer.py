"""The written layout, and what the writer refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data.recordings import make_frame, make_mask
from robust6dof.data import read_video, write_sequence
from robust6dof.data.depth_unit import metres_to_depth
from robust6dof.errors import DataError, InputError
from robust6dof.frames import RgbdFrame


def test_unnamed_frames_are_numbered_and_stamps_kept(tmp_path: Path) -> None:
    frames = (make_frame(i, stamp=0.1 * i) for i in range(12))
    masks = (make_mask() if i == 0 else None for i in range(12))
    assert write_sequence(tmp_path, frames, masks) == 12
    video = read_video(tmp_path)
    assert video.names == tuple(f"{i:06d}" for i in range(12))
    assert video[11].stamp == 0.1 * 11
    assert video.mask(0) is not None
    assert video.mask(1) is None
    assert not (tmp_path / "annotated_poses").exists()


def test_other_intrinsics_are_refused(tmp_path: Path) -> None:
    frame = make_frame()
    other = RgbdFrame(frame.rgb, frame.depth, frame.K * [[1.01], [1.0], [1.0]])
    with pytest.raises(InputError, match="same intrinsics"):
        write_sequence(tmp_path, [frame, other])


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "rgb" / "000000.png").mkdir(parents=True)
    with pytest.raises(DataError, match=r"000000\.png: could not be written"):
        write_sequence(tmp_path, [make_frame()])


def test_invalid_depth_becomes_zero() -> None:
    depth = np.array([[0.0, np.nan, np.inf, -1.0, 1.2344, 65.535, 70.0, 0.0004]])
    np.testing.assert_array_equal(metres_to_depth(depth), [[0, 0, 0, 0, 1234, 0, 0, 0]])
