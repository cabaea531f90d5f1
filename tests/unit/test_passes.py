"""Solvers that work in passes: sums, their spread, threads, interruption, going on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skyscatter.solvers.base import Answer, Asked, Rays
from skyscatter.solvers.options import Photons
from skyscatter.solvers.passes import solve_passes, worst_noise
from skyscatter.solvers.state import Checkpoint, RenderState
from skyscatter.tasks import Engine

RAYS = Rays(np.zeros((3, 3)), np.tile([0.0, 0.0, 1.0], (3, 1)), np.arange(3))


def module(stop_at: int = -1) -> Any:
    """A solver whose passes are normal deviates of mean 5 and spread 2; Ctrl-C in pass `stop_at`."""

    def solve_pass(context: Any, rays: Rays, number: int, options: Asked[Photons]) -> Answer:
        if number == stop_at:
            raise KeyboardInterrupt
        values = 5 + 2 * np.random.default_rng([options.how.seed, number]).normal(size=(len(rays.origins), 4))
        return Answer(values, 0 * values, {"Q": 0.5 * values, "order1": values - 1})

    return SimpleNamespace(passes=lambda options: options.how.samples or 1 << 12, solve_pass=solve_pass)


def solved(
    options: Asked[Photons], workers: int = 1, state: RenderState | None = None, stop_at: int = -1
) -> RenderState:
    state = state or RenderState.empty({}, 3, 4)
    state.complete = solve_passes(module(stop_at), None, RAYS, options, state, Engine(workers), None)
    return state


def test_mean_and_error_are_those_of_the_passes() -> None:
    state = solved(Asked(Photons(samples=7, seed=3)))
    values = np.array([module().solve_pass(None, RAYS, k, Asked(Photons(seed=3))).radiance for k in range(7)])
    np.testing.assert_allclose(state.radiance, values.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(state.standard_error, values.std(axis=0, ddof=1) / 7**0.5, rtol=1e-9)
    np.testing.assert_allclose(state.layers["Q_error"], 0.5 * state.standard_error, rtol=1e-9)
    np.testing.assert_allclose(state.layers["order1"], state.radiance - 1, rtol=1e-12)
    assert "order1_error" not in state.layers
    assert state.done.all()
    assert np.all(state.samples == 7)
    assert state.share == 1


def test_threads_change_no_digit() -> None:
    one, four = solved(Asked(Photons(samples=23))), solved(Asked(Photons(samples=23)), workers=4)
    np.testing.assert_array_equal(one.radiance, four.radiance)
    np.testing.assert_array_equal(one.standard_error, four.standard_error)


@pytest.mark.parametrize("workers", [1, 3])
def test_interrupted_work_goes_on_from_a_file(workers: int, tmp_path: Any) -> None:
    whole = solved(Asked(Photons(samples=20)))
    state = solved(Asked(Photons(samples=20)), workers, stop_at=12)
    assert not state.complete
    assert 2 <= state.passes <= 12
    assert state.share == state.passes / 20
    assert state.done.all(), "what was finished is worth a picture"
    state.save(tmp_path / "state.zarr")
    again = RenderState.empty({}, 3, 4)
    Checkpoint(tmp_path / "state.zarr").begin(again, tmp_path / "state.zarr")
    solved(Asked(Photons(samples=20)), workers, again)
    np.testing.assert_array_equal(again.radiance, whole.radiance)
    np.testing.assert_array_equal(again.standard_error, whole.standard_error)


def test_errors_are_not_swallowed() -> None:
    def fail(*_: Any) -> Answer:
        raise ValueError("broken")

    broken = SimpleNamespace(passes=lambda _: 8, solve_pass=fail)
    with pytest.raises(ValueError, match="broken"):
        solve_passes(broken, None, RAYS, Asked(Photons()), RenderState.empty({}, 3, 4), Engine(2), None)


def test_noise_ends_the_work_at_a_power_of_two() -> None:
    # The spread of 2 on 5 is a noise of 0.4 / sqrt(n): 0.05 after 64 passes.
    state = solved(Asked(Photons(noise=0.06)))
    assert state.passes in (64, 128)
    assert worst_noise(state) < 0.06
    assert worst_noise(solved(Asked(Photons(samples=state.passes // 2)))) >= 0.06


def test_progress_rises_to_one() -> None:
    seen: list[float] = []
    state = RenderState.empty({}, 3, 4)
    assert solve_passes(module(), None, RAYS, Asked(Photons(samples=9)), state, Engine(2), seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1
    assert 2 < len(seen) <= 10
