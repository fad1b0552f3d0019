"""Track household objects never seen before in RGB-D, and guide an aerial manipulator to them."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robust6dof.data import Video, read_video, register_depth
    from robust6dof.errors import DataError, InputError, Robust6dofError
    from robust6dof.frames import Box, PoseTracker, RgbdFrame, Track, TrackState
    from robust6dof.robot.aerial_manipulator import AerialManipulator, default_aerial_manipulator
    from robust6dof.servo.goal import look_down_goal
    from robust6dof.servo.pad_servo import PadServo, ServoCommand
    from robust6dof.tracking.surface.icp import IcpTracker
    from robust6dof.tracking.tracker import Tracker

__version__ = "0.1.0.dev0"

_HOMES = {
    "AerialManipulator": "robot.aerial_manipulator",
    "Box": "frames",
    "DataError": "errors",
    "IcpTracker": "tracking.surface.icp",
    "InputError": "errors",
    "PadServo": "servo.pad_servo",
    "PoseTracker": "frames",
    "RgbdFrame": "frames",
    "Robust6dofError": "errors",
    "ServoCommand": "servo.pad_servo",
    "Track": "frames",
    "TrackState": "frames",
    "Tracker": "tracking.tracker",
    "Video": "data",
    "default_aerial_manipulator": "robot.aerial_manipulator",
    "look_down_goal": "servo.goal",
    "read_video": "data",
    "register_depth": "data",
}

__all__ = [
    "AerialManipulator",
    "Box",
    "DataError",
    "IcpTracker",
    "InputError",
    "PadServo",
    "PoseTracker",
    "RgbdFrame",
    "Robust6dofError",
    "ServoCommand",
    "Track",
    "TrackState",
    "Tracker",
    "Video",
    "default_aerial_manipulator",
    "look_down_goal",
    "read_video",
    "register_depth",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that the command line starts at once."""
    if name not in _HOMES:
        raise AttributeError(f"module 'robust6dof' has no attribute '{name}'")
    return getattr(importlib.import_module(f"robust6dof.{_HOMES[name]}"), name)
