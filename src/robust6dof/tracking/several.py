"""Several objects in one stream: registered one by one, looked at in one call of the network."""

from __future__ import annotations

from collections.abc import Sequence

from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame, Track
from robust6dof.network.inputs import ViewFeatures
from robust6dof.tracking.encoder import encode_together
from robust6dof.tracking.tracker import BegunStep, Tracker


class SeveralTrackers:
    """Steps trackers together; each track is what its own tracker would have made of it.

    Args:
        trackers: one for each object, each started by itself. Those with the same network share
            its call: make them with `Tracker(ViewEncoder(net, …))` of one `net`.
    """

    def __init__(self, trackers: Sequence[Tracker]) -> None:
        self.trackers = tuple(trackers)

    def step(self, tracks: Sequence[Track], frame: RgbdFrame) -> tuple[Track, ...]:
        """Follow every object to `frame`; never raises on a bad image.

        Raises:
            InputError: not one track for each tracker.
        """
        if len(tracks) != len(self.trackers):
            raise InputError(f"{len(tracks)} tracks for {len(self.trackers)} trackers")
        pairs = zip(self.trackers, tracks, strict=True)
        begun = [tracker.begin(track, frame) for tracker, track in pairs]
        answers = self._answers(begun)
        return tuple(
            tracker.finish(step, frame, answer)
            for tracker, step, answer in zip(self.trackers, begun, answers, strict=True)
        )

    def _answers(self, begun: Sequence[BegunStep]) -> list[ViewFeatures | None]:
        answers: list[ViewFeatures | None] = [None] * len(begun)
        for net in {id(tracker.net): tracker.net for tracker in self.trackers}.values():
            asked = [
                (place, step.request)
                for place, (tracker, step) in enumerate(zip(self.trackers, begun, strict=True))
                if tracker.net is net and step.request is not None
            ]
            features = encode_together(net, [request for _, request in asked])
            for (place, _), answer in zip(asked, features, strict=True):
                answers[place] = answer
        return answers
