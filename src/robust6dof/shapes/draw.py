"""Draws a shape's parameters and remembers what was drawn, and from which range."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


class Draw:
    """A random generator whose named draws are kept, to be reported with the shape.

    Attributes:
        parameters: name → value drawn.
        ranges: name → (low, high), or the names of a choice.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.parameters: dict[str, float | str] = {}
        self.ranges: dict[str, tuple[float, float] | tuple[str, ...]] = {}

    def uniform(self, name: str, low: float, high: float) -> float:
        value = float(self.rng.uniform(low, high))
        self.parameters[name] = value
        self.ranges[name] = (low, high)
        return value

    def choice(self, name: str, weights: Mapping[str, float]) -> str:
        """One of the names, each as likely as its weight."""
        names = tuple(weights)
        chances = np.array([weights[key] for key in names], dtype=float)
        value = names[int(self.rng.choice(len(names), p=chances / chances.sum()))]
        self.parameters[name] = value
        self.ranges[name] = names
        return value

    def chance(self, name: str, probability: float) -> bool:
        """True with this probability; kept as "yes" or "no"."""
        return self.choice(name, {"yes": probability, "no": 1 - probability}) == "yes"
