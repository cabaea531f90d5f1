"""Optimal estimation and posteriors of problems whose answer is known."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from skyscatter.errors import ConvergenceError, DomainError, SkyscatterError
from skyscatter.inversion.estimation import optimal_estimation
from skyscatter.inversion.fitstate import FitState
from skyscatter.inversion.observations import Linearisation, Prediction
from skyscatter.inversion.posterior import sample_posterior

RNG = np.random.default_rng(3)
MATRIX = RNG.standard_normal((30, 4)) @ np.diag([3.0, 1.0, 0.3, 0.01])
SIGMA = RNG.uniform(0.5, 2.0, 30)


class Toy:
    """y = f(z), with a derivative by hand."""

    def __init__(self, y: Any, curve: float = 0.0, sigma: Any = SIGMA) -> None:
        self.y, self.sigma, self.curve, self.calls = np.asarray(y, float), sigma, curve, 0

    def predict(self, z: Any) -> Prediction:
        self.calls += 1
        x = MATRIX @ z
        return Prediction(x + self.curve * x**2, np.zeros(30))

    def predictions(self, states: Any) -> Iterator[Prediction]:
        yield from map(self.predict, states)

    def noise_variance(self, value: Any) -> Any:
        return np.asarray(self.sigma) ** 2

    def linearise(self, z: Any, steps: Any) -> Linearisation:
        x = MATRIX @ z
        return Linearisation(*self.predict(z), MATRIX * (1 + 2 * self.curve * x)[:, None])


def test_a_linear_problem_is_solved_as_in_the_book() -> None:
    """Estimate, covariance, averaging kernel and its parts by the formulae, to rounding."""
    truth = np.array([0.5, -1.0, 0.3, 2.0])
    y = MATRIX @ truth + SIGMA * RNG.standard_normal(30)
    found = optimal_estimation(Toy(y), np.zeros(4))
    information = MATRIX.T @ (MATRIX / SIGMA[:, None] ** 2)
    covariance = np.linalg.inv(information + np.eye(4))
    np.testing.assert_allclose(found.z, covariance @ (MATRIX.T @ (y / SIGMA**2)), atol=1e-10)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-9, atol=1e-12)
    gain = covariance @ MATRIX.T / SIGMA**2
    np.testing.assert_allclose(found.averaging_kernel, gain @ MATRIX, atol=1e-10)
    np.testing.assert_allclose(found.noise_covariance, (gain * SIGMA**2) @ gain.T, atol=1e-10)
    np.testing.assert_allclose(found.noise_covariance + found.smoothing_covariance, covariance, atol=1e-10)
    assert found.converged
    # The last column of the matrix is next to nothing: three numbers are told, and nothing of the fourth.
    assert 2.5 < np.trace(found.averaging_kernel) < 3.01
    assert found.averaging_kernel[3, 3] < 0.01


def test_a_curved_problem_ends_at_the_least_cost() -> None:
    """Beside scipy's minimiser; from a start where plain Gauss-Newton steps are too long."""
    y = Toy(np.zeros(30), 0.2).predict(np.array([1.0, 0.5, -0.5, 0.0])).value
    toy = Toy(y, 0.2)

    def cost(z: Any) -> float:
        return float(np.sum(((y - toy.predict(z).value) / SIGMA) ** 2) + z @ z)

    start = np.array([2.5, -1.5, 1.0, 0.0])
    found = optimal_estimation(toy, start, max_iterations=50)
    best = min((minimize(cost, s, tol=1e-12) for s in (start, found.z)), key=lambda r: r.fun)
    assert found.converged
    assert found.cost == pytest.approx(best.fun, abs=0.01)  # convergence stops 0.1 deviations short at most


def test_too_few_iterations_are_confessed() -> None:
    """And a model that is not finite is an error."""
    assert not optimal_estimation(Toy(np.full(30, 50.0), 0.2), np.full(4, 2.0), max_iterations=1).converged
    toy = Toy(np.zeros(30), np.nan)
    with pytest.raises(ConvergenceError):
        optimal_estimation(toy, np.ones(4))


def test_derivatives_that_lead_uphill_are_an_error() -> None:
    """Steps that damping has made short are no sign of a minimum."""

    class Wrong(Toy):
        def linearise(self, z: Any, steps: Any) -> Linearisation:
            value, error, jacobian = super().linearise(z, steps)
            return Linearisation(value, error, -jacobian)

    with pytest.raises(ConvergenceError, match="no step lowers the misfit"):
        optimal_estimation(Wrong(MATRIX @ np.array([0.5, -1.0, 0.3, 2.0])), np.zeros(4))


def test_the_truth_is_inside_as_often_as_stated() -> None:
    """Truths from the prior, a curved model: 95 % of joint regions hold them (2000 draws, within 3 deviations)."""
    rng, inside, count = np.random.default_rng(5), 0, 2000
    for _ in range(count):
        truth = rng.standard_normal(4)
        toy = Toy(Toy(np.zeros(30), 0.002).predict(truth).value + SIGMA * rng.standard_normal(30), 0.002)
        found = optimal_estimation(toy, np.zeros(4))
        off = truth - found.z
        inside += float(off @ np.linalg.solve(found.covariance, off)) < 9.488  # chi2, 4 degrees of freedom
    assert abs(inside / count - 0.95) < 3 * np.sqrt(0.95 * 0.05 / count)


@pytest.mark.parametrize("emulated", [False, True])
def test_the_posterior_of_a_linear_problem(emulated: bool) -> None:
    """Mean and covariance of the samples, within what so many independent samples leave to chance."""
    toy: Any = Toy(MATRIX @ np.array([0.5, -1.0, 0.3, 2.0]) + SIGMA)
    estimate = optimal_estimation(toy, np.zeros(4))
    state = FitState(None, {})
    found = sample_posterior(toy, estimate, state, {}, steps=1500, seed=1, emulated=emulated)
    root = np.linalg.cholesky(estimate.covariance)
    white = np.linalg.solve(root, (found.samples - estimate.z).T).T
    effective = found.diagnostics["effective_samples"]
    assert effective > 300
    assert np.abs(white.mean(axis=0)).max() < 4.5 / np.sqrt(effective)
    assert np.abs(np.cov(white, rowvar=False) - np.eye(4)).max() < 4.5 * np.sqrt(2 / effective)
    assert 0.2 < found.diagnostics["acceptance"] < 0.8
    if emulated:
        assert found.diagnostics["emulator_error_in_sigma"] < 1e-8  # a quadratic holds a straight line


def test_an_interrupted_walk_goes_on_with_the_same_numbers(tmp_path: Path) -> None:
    """Stopped in the middle of the chain by Ctrl-C, and begun again from the file."""
    y = MATRIX @ np.ones(4)

    class Stopping(Toy):
        def predict(self, z: Any) -> Prediction:
            if self.calls == 700:
                self.calls += 1
                raise KeyboardInterrupt
            return super().predict(z)

    whole: Any = Toy(y)
    estimate = optimal_estimation(whole, np.zeros(4))
    options: dict[str, Any] = {"steps": 60, "seed": 4, "emulated": False}
    expected = sample_posterior(whole, estimate, FitState(None, {}), {}, **options)
    broken: Any = Stopping(y)
    state = FitState(tmp_path / "walk.zarr", {"who": "me"})
    with pytest.raises(KeyboardInterrupt):
        sample_posterior(broken, estimate, state, {}, **options)
    kept = FitState(tmp_path / "walk.zarr", {"who": "me"}).load()
    assert kept is not None
    assert 0 < len(kept["chain"]) < 60
    after = sample_posterior(broken, estimate, state, kept, **options)
    np.testing.assert_array_equal(after.samples, expected.samples)
    with pytest.raises(DomainError, match="other who"):
        FitState(tmp_path / "walk.zarr", {"who": "you"}).load()
    (tmp_path / "mine.txt").write_bytes(b"nothing")
    with pytest.raises(DomainError, match=r"resume = .* is no store"):
        FitState(tmp_path / "mine.txt", {"who": "me"}).load()
    assert (tmp_path / "mine.txt").read_bytes() == b"nothing"


def test_without_emcee_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, before any time is spent."""
    monkeypatch.setitem(sys.modules, "emcee", None)
    import skyscatter

    with pytest.raises(SkyscatterError, match="pip install emcee corner"):
        skyscatter.fit("earth", "nowhere.csv", ["ground.albedo"], method="posterior")


def test_noise_that_is_a_share_leads_nowhere_astray() -> None:
    """A scale from many readings with 10 % noise each: weights by the readings would leave it 1 % low, 3 deviations."""
    rng = np.random.default_rng(8)
    y = 1 + 0.1 * rng.standard_normal((400, 1000))

    class Scale(Toy):
        def predict(self, z: Any) -> Prediction:
            return Prediction(np.full(self.y.size, 1 + z[0]), np.zeros(self.y.size))

        def noise_variance(self, value: Any) -> Any:
            return (0.1 * value) ** 2

        def linearise(self, z: Any, steps: Any) -> Linearisation:
            return Linearisation(*self.predict(z), np.ones((self.y.size, 1)))

    found = [optimal_estimation(Scale(row), np.zeros(1)) for row in y]
    off = np.array([f.z[0] / np.sqrt(f.covariance[0, 0]) for f in found])
    assert abs(off.mean()) < 3 / np.sqrt(len(off))
    assert off.std() == pytest.approx(1, abs=3 / np.sqrt(2 * len(off)))


@pytest.mark.slow
def test_an_emulator_that_fails_says_so() -> None:
    """A model with a kink, which no quadratic follows: the report warns; a straight one does not."""
    from types import SimpleNamespace

    from skyscatter.inversion.report import sampling

    class Kinked(Toy):
        def predict(self, z: Any) -> Prediction:
            x = MATRIX @ z
            return Prediction(x + 60 * np.maximum(np.abs(z[0] - 1) - 0.02, 0), np.zeros(30))

    for kind, warns in ((Kinked, True), (Toy, False)):
        toy: Any = kind(MATRIX @ np.array([1.0, 0.0, 0.0, 0.0]))
        estimate = optimal_estimation(toy, np.array([1.0, 0.0, 0.0, 0.0]))
        found = sample_posterior(toy, estimate, FitState(None, {}), {}, steps=400, seed=2, emulated=True)
        lines: Any = sampling(SimpleNamespace(diagnostics=found.diagnostics))  # type: ignore[arg-type]
        assert any("emulator is not to be trusted" in line for line in lines) == warns


def test_an_interrupted_estimation_goes_on_to_the_same_numbers() -> None:
    toy = Toy(np.full(30, 50.0), 0.2)
    states: list[dict[str, Any]] = []
    whole = optimal_estimation(toy, np.full(4, 2.0), keep=states.append)
    assert len(states) > 2
    for state in states:
        again = optimal_estimation(toy, np.full(4, 2.0), kept=state)
        for name, value in vars(whole).items():
            np.testing.assert_array_equal(getattr(again, name), value)
