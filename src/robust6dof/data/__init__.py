"""Recordings and data sets on disk: read, checked, written."""

from robust6dof.data.registration import register_depth
from robust6dof.data.sequence_writer import SequenceWriter, write_sequence
from robust6dof.data.video import Video, read_video

__all__ = ["SequenceWriter", "Video", "read_video", "register_depth", "write_sequence"]
