"""Two independent halves of what random walks and photons find, beside their mean: what denoising is judged by.

A solver is wrapped into one with two more layers, ``half_a`` and ``half_b``.  Walks are counted in batches that know
nothing of each other, and passes are independent anyway: every second one belongs to the first half, the others to the
second, at no cost in time and with the same numbers as without.  The halves hold only what chance decides; what a
solver knows without it, such as light scattered once, is not in them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.image.denoising import HALVES
from skyscatter.solvers.base import Answer, Asked, Rays, Walks

#: Ways of the solver path that keep no sums of batches.
_PLAIN = ("free-flight", "delta")


@dataclass(frozen=True)
class Halves:
    """A solver that tells two halves of its walks or passes apart; all else it leaves to the one that it wraps."""

    module: Any

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "module":
            raise AttributeError(name)
        return getattr(self.module, name)

    def check(self, asked: Asked[Any]) -> None:
        """Refuse what the solver refuses, and what cannot be halved."""
        self.module.check(asked)
        if not getattr(self.module, "PASSES", False) and not hasattr(self.module, "no_walks"):
            raise DomainError("halves", True, "has no noise to be halved; choose the solver path or photons")
        if asked.stokes:
            raise DomainError("stokes", True, "is not for pictures to be denoised, which is done for I alone")
        if getattr(asked.how, "sampling", None) in _PLAIN:  # photons have no such option
            raise DomainError("sampling", asked.how.sampling, "keeps no halves; leave it out where noise is taken off")
        if asked.how.samples is not None and self._counts(asked) % 2:
            raise DomainError("samples", asked.how.samples, "an even number of walks of each ray, for two equal halves")

    def _counts(self, asked: Asked[Any]) -> int:
        """Walks or passes."""
        if getattr(self.module, "PASSES", False):
            return int(self.module.passes(asked))
        from skyscatter.solvers.path import walks_for

        return walks_for(asked)

    def solve(self, context: Any, rays: Rays, asked: Asked[Any], walks: Walks | None = None) -> Answer:
        """Radiance with its halves, each the mean over every second batch of walks."""
        walks = walks or self.module.no_walks(context, len(rays.origins), asked)
        answer = self.module.solve(context, rays, asked, walks)
        sums, used = walks.sums[:, 0], np.maximum(answer.samples, 1)[:, None]
        halves = {name: 2.0 * sums[:, k::2].sum(axis=1) / used for k, name in enumerate(HALVES)}
        return replace(answer, layers={**answer.layers, **halves})

    def solve_pass(self, context: Any, rays: Rays, number: int, asked: Asked[Any]) -> Answer:
        """One pass, doubled in the layer of its half: the means over all passes are then those of the halves."""
        answer = self.module.solve_pass(context, rays, number, asked)
        mine = {name: (2.0 if number % 2 == k else 0.0) * answer.radiance for k, name in enumerate(HALVES)}
        return replace(answer, layers={**answer.layers, **mine})
