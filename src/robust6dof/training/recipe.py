"""How to train: the paper's recipe, and what was found to be better, by name."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robust6dof.errors import InputError


@dataclass(frozen=True)
class Recipe:
    """Optimiser and schedule."""

    learning_rate: float = 1e-3
    """Of Adam; the peak of a schedule."""
    batch: int = 32
    """Pairs in each step, over all processes."""
    steps: int = 50_000
    """Of the optimiser. The paper's 50 epochs, taken as 1,000 steps of 32 pairs each."""
    schedule: str = "constant"
    """`constant`, or `cosine`: a warm-up of 2 % of the steps and a half cosine down to 1 %."""
    clip: float = 0.0
    """Largest norm of the gradient; 0 clips nothing."""
    ema: float = 0.0
    """Decay of the running mean of the weights, which is what is validated and saved; 0: none."""

    def rate(self, step: int) -> float:
        """Learning rate at a step."""
        if self.schedule == "constant":
            return self.learning_rate
        warm = max(1, self.steps // 50)
        if step < warm:
            return self.learning_rate * (step + 1) / warm
        progress = min(1.0, (step - warm) / max(1, self.steps - warm))
        return self.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * progress)))


RECIPES: dict[str, Recipe] = {
    "paper": Recipe(),
    "short": Recipe(
        learning_rate=1.5e-3, batch=16, steps=4_000, schedule="cosine", clip=1.0, ema=0.998
    ),
    "refine": Recipe(
        learning_rate=5e-4, batch=16, steps=2_000, schedule="cosine", clip=1.0, ema=0.998
    ),
}
"""`paper`: Adam, 1e-3, batch 32. `short`: for a CPU; cosine, clipping and a running mean. `refine`:
the same at a third of the rate, for weights that are good already (`--init`)."""


def recipe_named(name: str) -> Recipe:
    """A recipe by name.

    Raises:
        InputError: no such recipe.
    """
    if name not in RECIPES:
        raise InputError(f"no recipe '{name}'; there is: {', '.join(RECIPES)}")
    return RECIPES[name]
