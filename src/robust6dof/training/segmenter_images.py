"""Pictures of the synthetic world with the mask and category of every object in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int, UInt8

from robust6dof.frames import CATEGORIES
from robust6dof.rendering.d435i import color_camera
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.scene import MeshInstance, Scene
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.aerial_world import AerialWorld
from robust6dof.synthetic.plans import FIRST_TEST_SHAPE
from robust6dof.synthetic.sequence import SyntheticSequence

LEAST_PIXELS = 60
"""What shows less is left out: nobody would start on it."""

_OTHER_ID = 1
_FIRST_ID = 2
_FRAMES = 30
_DIFFICULTIES = ("calm", "agile", "harsh")


@dataclass(frozen=True, eq=False)
class LabelledImage:
    """One picture, as Mask R-CNN is trained on it."""

    rgb: UInt8[np.ndarray, "H W 3"]
    labels: Int[np.ndarray, "N"]
    """1 and up, in the order of CATEGORIES."""
    masks: Bool[np.ndarray, "N H W"]
    """Visible pixels of each object."""


def draw_labelled_image(seed: int, number: int) -> LabelledImage:
    """Picture `number` of a stream: a moment of an aerial recording, through its colour camera.

    Shapes are those of training, never those of AerialPose-Sim. The picture has the camera's noise
    and blur, the masks have not. Where nothing is free of what crosses in front, none is labelled.
    """
    rng = np.random.default_rng([seed, number])
    category = CATEGORIES[int(rng.integers(len(CATEGORIES)))]
    target = make_object(category, int(rng.integers(FIRST_TEST_SHAPE)))
    difficulty = _DIFFICULTIES[int(rng.integers(len(_DIFFICULTIES)))]
    sequence = SyntheticSequence.draw(target, difficulty, int(rng.integers(2**31)), _FRAMES)
    free = _free_moments(sequence)
    index = int(rng.choice(free)) if free else 0
    frame, _ = sequence.frame(index)
    image = _labelled(frame.rgb, sequence, sequence.stamps[index])
    return image if free else LabelledImage(image.rgb, image.labels[:0], image.masks[:0])


def _free_moments(sequence: SyntheticSequence) -> list[int]:
    """Frames without anything crossing in front, of which the masks would know nothing."""
    events = [bar.event for bar in sequence.occluders]
    return [
        index
        for index, stamp in enumerate(sequence.stamps)
        if not any(event.start < stamp < event.end for event in events)
    ]


def _labelled(
    rgb: UInt8[np.ndarray, "H W 3"], sequence: SyntheticSequence, time: float
) -> LabelledImage:
    world = sequence.world
    T_world_cam = sequence.motion.T_world_cam(time, world.T_world_obj(time)[:3, 3])
    ids = render(_with_own_ids(world, time), color_camera(T_world_cam)).ids
    objects = [world.target, *world.others]
    masks = np.array([ids == _FIRST_ID + number for number in range(len(objects))])
    kept = masks.sum(axis=(1, 2)) >= LEAST_PIXELS
    labels = np.array([1 + CATEGORIES.index(one.model.category) for one in objects])
    return LabelledImage(rgb, labels[kept], masks[kept])


def _with_own_ids(world: AerialWorld, time: float) -> Scene:
    """The scene with a number of its own for each object of a category."""
    scene = world.scene(time)
    own = {
        id(standing.model.mesh): _FIRST_ID + number
        for number, standing in enumerate([world.target, *world.others])
    }

    def numbered(instance: MeshInstance) -> MeshInstance:
        return replace(instance, instance_id=own.get(id(instance.mesh), _OTHER_ID))

    return replace(scene, instances=[numbered(instance) for instance in scene.instances])
