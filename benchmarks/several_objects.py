"""Time of one frame for 1, 2, 4 and 8 objects, the network called once for all or once for each.

    python benchmarks/several_objects.py RECORDING [--threads 2]

All trackers follow the one object of the recording, each with points of its own: the work is that
of as many objects.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from robust6dof.data import read_video
from robust6dof.data.truth_file import FILE_NAME, read_truth_file
from robust6dof.shapes.priors import load_prior
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.pretrained import load_pretrained
from robust6dof.tracking.several import SeveralTrackers
from robust6dof.tracking.tracker import Tracker

COUNTS = (1, 2, 4, 8)
_WARM = 4


def main() -> None:
    parser = argparse.ArgumentParser(description="Time several objects")
    parser.add_argument("recording", type=Path)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    truth = read_truth_file(options.recording / FILE_NAME)[0]
    frames = list(read_video(options.recording))
    net, prior = load_pretrained(), load_prior(truth.category)
    trackers = [
        Tracker(ViewEncoder(net, prior, truth.category, seed)) for seed in range(max(COUNTS))
    ]
    started = [
        each.start(frames[0], T_cam_obj=truth.T_cam_obj, extents=truth.extents) for each in trackers
    ]
    print("objects | together, ms a frame | one by one, ms a frame")
    for count in COUNTS:
        several = SeveralTrackers(trackers[:count])
        together = apart = tuple(started[:count])
        ms: dict[str, list[float]] = {"together": [], "apart": []}
        for frame in frames[1:]:
            begin = time.perf_counter()
            together = several.step(together, frame)
            middle = time.perf_counter()
            apart = tuple(
                each.step(track, frame) for each, track in zip(trackers, apart, strict=False)
            )
            ms["together"].append(1e3 * (middle - begin))
            ms["apart"].append(1e3 * (time.perf_counter() - middle))
        medians = [float(np.median(values[_WARM:])) for values in ms.values()]
        print(f"{count} | {medians[0]:.0f} | {medians[1]:.0f}", flush=True)


if __name__ == "__main__":
    main()
