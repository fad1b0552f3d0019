"""Recordings and data sets on disk: read, checked, written."""

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.data.recognition import open_dataset
from robust6dof.data.registration import register_depth
from robust6dof.data.sequence_writer import SequenceWriter, write_sequence
from robust6dof.data.video import Video, read_video

__all__ = [
    "Dataset",
    "DatasetSequence",
    "ObjectTruth",
    "SequenceWriter",
    "Video",
    "open_dataset",
    "read_video",
    "register_depth",
    "write_sequence",
]
