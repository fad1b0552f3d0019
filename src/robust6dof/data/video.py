"""`read_video`: a recording on disk as a lazy sequence of registered RGB-D frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import overload

import numpy as np
from jaxtyping import Bool, Float, Float32

from robust6dof.data.calibration import Calibration, fit_intrinsics, read_calibration
from robust6dof.data.depth_unit import MILLIMETRE, check_depth_unit, depth_to_metres
from robust6dof.data.gyro import frame_orientations
from robust6dof.data.image_files import (
    image_size,
    read_color,
    read_depth,
    read_mask,
    read_matrix,
    read_transform,
)
from robust6dof.data.layouts import FrameFiles, find_recording
from robust6dof.data.registration import register_depth
from robust6dof.data.stamps import frame_stamps
from robust6dof.errors import DataError
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform


@dataclass(frozen=True, eq=False)
class Video:
    """An RGB-D recording: `len`, index, slice, iterate; each frame is read when asked for."""

    path: Path
    layout: str
    files: tuple[FrameFiles, ...]
    stamps: tuple[float | None, ...]
    calibration: Calibration
    depth_unit_m: float = MILLIMETRE
    """What one step of the depth images is worth [m]."""
    depth_only: bool = False
    """Frames are those of the depth camera and carry no colour."""
    orientations: tuple[Float[np.ndarray, "3 3"] | None, ...] = ()
    """`R_ref_cam` of each frame's colour camera by the recording's gyro; empty without one."""

    def __len__(self) -> int:
        return len(self.files)

    @overload
    def __getitem__(self, index: int) -> RgbdFrame: ...
    @overload
    def __getitem__(self, index: slice) -> Video: ...
    def __getitem__(self, index: int | slice) -> RgbdFrame | Video:
        """One frame, or a part of the recording as a `Video` of its own.

        Raises:
            DataError: a file that is missing, truncated, or does not fit the others.
        """
        if isinstance(index, slice):
            return replace(
                self,
                files=self.files[index],
                stamps=self.stamps[index],
                orientations=self.orientations[index],
            )
        return self._read(self.files[index], self.stamps[index], self._orientation(index))

    def __iter__(self) -> Iterator[RgbdFrame]:
        return (self[index] for index in range(len(self)))

    @property
    def names(self) -> tuple[str, ...]:
        """The recording's own names of its frames."""
        return tuple(files.name for files in self.files)

    def mask(self, index: int) -> Bool[np.ndarray, "H W"] | None:
        """Object mask of a frame, None where the recording has none.

        Raises:
            DataError: truncated, or of another size than the frame.
        """
        files = self.files[index]
        if files.mask is None:
            return None
        mask = read_mask(files.mask)
        reference = files.depth if self.depth_only or files.color is None else files.color
        expected = _shape(reference)
        if mask.shape != expected:
            raise DataError(
                files.mask,
                f"the mask is {_size_text(mask.shape)} but its image is {_size_text(expected)}",
                "Draw the mask on the image itself",
            )
        lens = self._lens()
        return lens(mask.astype(np.uint8)) > 0 if lens else mask

    def annotated_pose(self, index: int) -> Float[np.ndarray, "4 4"] | None:
        """Annotated `T_cam_obj` of a frame (rigid, metres), None where there is none.

        With `depth_only` and a known `T_color_depth` it is taken over to the depth camera.

        Raises:
            DataError: the file is not a rigid transform.
        """
        path = self.files[index].annotated_pose
        if path is None:
            return None
        T_color_obj = read_transform(path)
        T_color_depth = self.calibration.T_color_depth
        if self.depth_only and T_color_depth is not None:
            return invert_transform(T_color_depth) @ T_color_obj
        return T_color_obj

    def camera_pose(self, index: int) -> Float[np.ndarray, "4 4"] | None:
        """`T_world_cam` of a frame; None where the layout has none or the recorder lost itself.

        Raises:
            DataError: the file is not a rigid transform.
        """
        path = self.files[index].camera_pose
        if path is None or not np.isfinite(read_matrix(path, (4, 4))).all():
            return None
        return read_transform(path)

    def _orientation(self, index: int) -> Float[np.ndarray, "3 3"] | None:
        R_ref_color = self.orientations[index] if self.orientations else None
        T_color_depth = self.calibration.T_color_depth
        if R_ref_color is None or T_color_depth is None or not self.depth_only:
            return R_ref_color
        return R_ref_color @ T_color_depth[:3, :3]

    def _read(
        self, files: FrameFiles, stamp: float | None, R_ref_cam: np.ndarray | None
    ) -> RgbdFrame:
        depth = depth_to_metres(read_depth(files.depth), self.depth_unit_m)
        if self.depth_only or files.color is None:
            rgb, depth, K = self._read_depth_frame(depth, files)
        else:
            rgb, depth, K = self._read_color_frame(read_color(files.color), depth, files)
        return RgbdFrame(rgb, depth, K, stamp, files.name, not self.depth_only, R_ref_cam)

    def _read_depth_frame(
        self, depth: Float32[np.ndarray, "H W"], files: FrameFiles
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        K = self._depth_intrinsics(depth, files)
        lens = self._lens()
        rgb = np.zeros((*depth.shape, 3), dtype=np.uint8)
        return rgb, lens(depth) if lens else depth, K

    def _depth_intrinsics(self, depth: np.ndarray, files: FrameFiles) -> np.ndarray:
        size, calibration = depth.shape[::-1], self.calibration
        if calibration.K_depth is not None:
            return fit_intrinsics(calibration.K_depth, size, self.path / "cam_K_depth.txt")
        if files.color is not None and _shape(files.color) != depth.shape:
            raise DataError(
                files.depth,
                f"depth is {_size_text(depth.shape)}, unlike the colour, and its camera is unknown",
                "Give K_depth (or cam_K_depth.txt)",
            )
        return fit_intrinsics(calibration.K, size, calibration.K_source)

    def _read_color_frame(
        self, rgb: np.ndarray, depth: Float32[np.ndarray, "H W"], files: FrameFiles
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        calibration, size = self.calibration, (rgb.shape[1], rgb.shape[0])
        K = fit_intrinsics(calibration.K, size, calibration.K_source)
        distortion = calibration.distortion
        if distortion is not None:
            rgb = distortion.undistort(rgb, K, smooth=True)
        if calibration.K_depth is not None or calibration.T_color_depth is not None:
            return rgb, self._registered(depth, K, size, files), K
        if depth.shape != rgb.shape[:2]:
            raise DataError(
                files.depth,
                f"depth is {_size_text(depth.shape)} but colour is {_size_text(rgb.shape)}, and "
                "how the two cameras stand to each other is unknown",
                "Give K_depth and T_color_depth (or cam_K_depth.txt and T_color_depth.txt), "
                "or pass depth_only=True",
            )
        return rgb, depth if distortion is None else distortion.undistort(depth, K, False), K

    def _registered(
        self,
        depth: Float32[np.ndarray, "H W"],
        K: np.ndarray,
        color_size: tuple[int, int],
        files: FrameFiles,
    ) -> np.ndarray:
        calibration = self.calibration
        if calibration.K_depth is None or calibration.T_color_depth is None:
            given = "cam_K_depth" if calibration.T_color_depth is None else "T_color_depth"
            raise DataError(
                files.depth,
                f"registering depth needs K_depth and T_color_depth, but only {given} is known",
                "Give both (or cam_K_depth.txt and T_color_depth.txt), or pass depth_only=True",
            )
        K_depth = self._depth_intrinsics(depth, files)
        return register_depth(depth, K_depth, K, calibration.T_color_depth, color_size)

    def _lens(self):
        """Undistortion of what is seen through the colour camera's lens, None where not needed."""
        calibration = self.calibration
        separate = self.depth_only and calibration.K_depth is not None
        if calibration.distortion is None or separate:
            return None
        distortion = calibration.distortion
        return lambda image: distortion.undistort(image, calibration.K, smooth=False)


def read_video(
    path: str | Path,
    *,
    fps: float | None = None,
    depth_only: bool = False,
    depth_unit_m: float | None = None,
    K_depth: Float[np.ndarray, "3 3"] | None = None,
    T_color_depth: Float[np.ndarray, "4 4"] | None = None,
    dist_coeffs: Float[np.ndarray, "N"] | None = None,
) -> Video:
    """Open an RGB-D recording in one of two layouts.

    - `rgb/*.png|jpg`, `depth/*.png` (uint16 mm), `cam_K.txt`; optional `masks/`,
      `annotated_poses/*.txt` (T_cam_obj): what the field's tools read and write.
    - `frame-*.color.jpg|png`, `frame-*.depth.png` (uint16 mm), `camera-intrinsics.txt`, optional
      `frame-*.pose.txt` (T_world_cam), in the folder or in its `data/`: 7-Scenes, tsdf-fusion.

    Frames are sorted and paired by name. Depth 0 and 65535 are invalid. The first frame is read
    at once, so that a wrong calibration or unit shows here.

    Depth is taken as registered to the colour unless a depth camera is given. Equal image sizes
    do not prove that it is (raw Kinect recordings, 7-Scenes): pass `depth_only=True` for those.

    A gyro's `gyro.csv` (stamp,wx,wy,wz in s and rad/s, see `robust6dof.data.gyro`) tells how the
    camera turned, and so where to look in the next frame.

    Args:
        path: the folder.
        fps: frame rate [Hz] for time stamps; goes before the folder's `stamps.txt` (seconds,
            one a line, or frame name and seconds).
        depth_only: give the depth camera's frames, without colour.
        depth_unit_m: what one step of the depth images is worth [m]; when not given,
            millimetres, refused where no indoor recording has such a range.
        K_depth: intrinsics of a separate depth camera [px] (else `cam_K_depth.txt`).
        T_color_depth: depth-camera to colour-camera coordinates (else `T_color_depth.txt`).
        dist_coeffs: lens distortion of the colour camera in OpenCV's order
            (else `dist_coeffs.txt`); images are undistorted to a pinhole with the same K.

    Raises:
        DataError: an unknown layout, no frames, files that are missing, truncated or do not fit
            each other, intrinsics of another image size, an implausible depth unit, an unusable
            gyro.
        InputError: an unusable option.
    """
    path = Path(path)
    recording = find_recording(path, depth_only)
    stamps = frame_stamps(path, [files.name for files in recording.frames], fps)
    video = Video(
        path,
        recording.layout,
        recording.frames,
        stamps,
        read_calibration(path, recording.intrinsics, K_depth, T_color_depth, dist_coeffs),
        MILLIMETRE if depth_unit_m is None else depth_unit_m,
        depth_only,
        frame_orientations(path, stamps),
    )
    video[0]
    if depth_unit_m is None:
        _check_unit(video)
    return video


def _check_unit(video: Video, samples: int = 5) -> None:
    """Judge the unit by the first of a few frames that has depth on a hundredth of its pixels."""
    for index in np.unique(np.linspace(0, len(video) - 1, samples).astype(int)):
        path = video.files[index].depth
        depth = depth_to_metres(read_depth(path), video.depth_unit_m)
        if np.mean(depth > 0) > 0.01:
            return check_depth_unit(depth, video.depth_unit_m, path)


def _shape(path: Path) -> tuple[int, int]:
    width, height = image_size(path)
    return height, width


def _size_text(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}×{shape[0]}"
