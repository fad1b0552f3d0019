"""A mug followed by the network's tracker through a few rendered frames."""

from __future__ import annotations

from functools import cache

import numpy as np

from baselines.tabletop_scene import look_at_object, make_tabletop
from robust6dof.tracking.tracker import Tracker
from robust6dof.visualization.track_view import TrackView, make_track_view

FRAMES = 4


@cache
def mug_views() -> tuple[TrackView, ...]:
    """Each frame's view; the network looks at every other frame."""
    scene, rng = make_tabletop("mug", 0), np.random.default_rng(0)
    cameras = [look_at_object(0.7 + 0.02 * index, 0.7, 0.6) for index in range(FRAMES)]
    shots = [scene.shoot(camera, rng, index / 20) for index, camera in enumerate(cameras)]
    tracker = Tracker.from_pretrained(category="mug", device="cpu")
    extents = scene.model.extents
    track = tracker.start(shots[0].frame, T_cam_obj=shots[0].T_cam_obj, extents=extents)
    views = [make_track_view(shots[0].frame, track, None, tracker.net)]
    for shot in shots[1:]:
        before, track = track, tracker.step(track, shot.frame)
        views.append(make_track_view(shot.frame, track, before, tracker.net, ms=12.5))
    return tuple(views)
