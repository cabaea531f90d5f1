"""Kinds of one's own: a class outside the package that stands wherever one that comes along may."""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import skyscatter
from skyscatter import fields
from skyscatter.errors import DomainError, ModelFileError
from skyscatter.kernels.codes.shells import LINEAR, FieldRow
from skyscatter.media.fields import DensityField, Tabulated
from skyscatter.media.space import FieldTerm, SpatialField
from skyscatter.optics.base import Coefficients, OpticalModel, PhaseFunction
from skyscatter.optics.phase import Isotropic, Rayleigh
from skyscatter.record import Record
from skyscatter.registry import OWN, register

Array = Any


class HalfAndHalf(PhaseFunction):
    """Isotropic and Rayleigh's by shares."""

    kind: Literal["half-and-half"] = "half-and-half"
    share: float = 0.5

    def value(self, cos_theta: Any, wavelengths_nm: Any) -> Array:
        parts = [one.value(cos_theta, wavelengths_nm) for one in (Isotropic(), Rayleigh())]
        return self.share * parts[0] + (1 - self.share) * parts[1]

    def mean_cosine(self, wavelengths_nm: Any) -> Array:
        return np.zeros(np.size(wavelengths_nm))

    def sample(self, u: Any, wavelength_nm: float) -> Array:
        raise NotImplementedError  # kernels draw from the table of values


class Step(DensityField):
    """As dense at all heights up to a top: one row of the kernels' table."""

    kind: Literal["step"] = "step"
    top: float

    def row(self) -> FieldRow:
        return FieldRow(LINEAR, (), self.top, (0.0, self.top), (1.0, 1.0), (self.top,))


class Twins(SpatialField):
    """Two balls side by side, out of the package's own."""

    kind: Literal["twins"] = "twins"
    apart: float

    def _both(self) -> SpatialField:
        ball = fields.Sphere(radius=1.0)
        return ball.moved((self.apart, 0, 0)) + ball.moved((-self.apart, 0, 0))

    def terms(self) -> tuple[FieldTerm, ...]:
        return self._both().terms()

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        return self._both().extremes(low, high)


class Smoke(OpticalModel):
    """Scatters and absorbs half and half, per metre of unit density."""

    kind: Literal["smoke"] = "smoke"
    extinction: float

    def coefficients(self, wavelengths_nm: Any, column_m: float) -> Coefficients:
        half = np.full(np.size(wavelengths_nm), 0.5 * self.extinction)
        return Coefficients(half, half, 0 * half)

    def phase_function(self, wavelengths_nm: Any) -> PhaseFunction:
        return HalfAndHalf()


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    """The classes above, for one test."""
    before = {contract: dict(own) for contract, own in OWN.items()}
    for record in (HalfAndHalf, Step, Twins, Smoke):
        register(record)
    yield
    for contract, own in OWN.items():
        own.clear()
        own.update(before.get(contract, {}))


SKY = """
name = "mine"
[planet]
name = "ball"
radius = 1e6
[ground]
albedo = 0.3
[[components]]
name = "haze"
density = { kind = "step", top = 1e4 }
optics = { kind = "particles", optical_depth = 0.4, single_scattering_albedo = 0.9, phase = { kind = "half-and-half" } }
[[components]]
name = "smoke"
density = { kind = "exponential", scale_height = 2e3 }
optics = { kind = "smoke", extinction = 1e-5 }
"""


def sky(tmp_path: Path, text: str = SKY) -> Any:
    (tmp_path / "sky.toml").write_text(text)
    return skyscatter.load_model(tmp_path / "sky.toml")


def test_a_sky_of_own_classes_is_that_of_the_same_numbers(tmp_path: Path) -> None:
    """Density, optics and phase function by name, solved by quadrature and by orders, beside tables of the same."""
    scene = sky(tmp_path).scene(sun_elevation_deg=40.0)
    assert [type(part) for c in scene.medium.components for part in (c.density, c.optics)][::3] == [Step, Smoke]
    haze, smoke = scene.medium.components
    table = Tabulated(altitudes=(0.0, 1e4), densities=(1.0, 1.0), interpolation="linear")
    mu = np.linspace(-1, 1, 2001)
    values = HalfAndHalf().value(mu, [550.0])[:, 0]
    phase = {"kind": "phase-table", "cos_theta": mu, "wavelengths": [550.0], "values": values[:, None]}
    plain = skyscatter.Medium(
        planet_radius=1e6,
        components=(
            haze.model_copy(
                update={
                    "density": table,
                    "optics": skyscatter.Particles(optical_depth=0.4, single_scattering_albedo=0.9, phase=phase),
                }
            ),
            smoke.model_copy(
                update={"optics": skyscatter.Particles(extinction=1e-5, single_scattering_albedo=0.5, phase=phase)}
            ),
        ),
    )
    other = scene.model_copy(update={"medium": plain})
    d = np.array([[0.6, 0.0, 0.8], [0.0, 0.9, np.sqrt(0.19)]])
    for solver in ("single", "orders"):
        own, same = (
            skyscatter.radiance(one, one.observer.position, d, [550.0], solver).radiance for one in (scene, other)
        )
        # Straight lines between 2001 cosines: 1e-6 of the curve.
        np.testing.assert_allclose(own, same, rtol=1e-5)


def test_own_classes_are_written_and_read_again(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = sky(tmp_path)
        model.save(tmp_path / "again.toml")
    assert skyscatter.load_model(tmp_path / "again.toml") == model
    assert 'kind = "half-and-half"' in model.to_toml()


def test_an_own_field_in_space() -> None:
    """Its column is that of two balls, alone and within operations, and walks find their way through it."""
    twins = Twins(apart=2.0)
    assert twins.column([2, 0, -5], [2, 0, 5]) == pytest.approx(2.0)
    assert (2 * twins).moved((0, 1, 0)).column([-5, 1, 0], [5, 1, 0]) == pytest.approx(8.0)
    dust = skyscatter.Component(
        name="dust",
        density={"kind": "twins", "apart": 2.0},
        optics=skyscatter.Particles(extinction=0.5, single_scattering_albedo=0.9, phase={"kind": "isotropic"}),
    )
    scene = skyscatter.SpaceScene(medium=skyscatter.Medium(components=(dust,)), background=1.0)
    answer = skyscatter.transmittance(scene, [2, 0, -5], [2, 0, 5], [550.0])
    np.testing.assert_allclose(answer, np.exp(-1.0), rtol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("step", "stepp", "stepp"),
        ("top = 1e4", "tip = 1e4", "tip = 10000.0: no such field; did you mean top?"),
        ('"half-and-half"', '"half-and-half", share = "much"', "share = 'much'"),
    ],
)
def test_what_is_wrong_in_an_own_kind_is_said(old: str, new: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ModelFileError) as caught:
        sky(tmp_path, SKY.replace(old, new))
    assert message in str(caught.value)


class Kindless(PhaseFunction):
    pass


class Stranger(Record):
    kind: Literal["stranger"] = "stranger"


class SecondStep(DensityField):
    kind: Literal["step"] = "step"


class Shadow(PhaseFunction):
    kind: Literal["rayleigh"] = "rayleigh"


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (Kindless, "needs a field kind"),
        (Stranger, "derive it from one of"),
        (SecondStep, "is that of Step"),
        (Shadow, "is that of Rayleigh"),
    ],
)
def test_what_cannot_be_registered_is_refused(record: Any, message: str) -> None:
    with pytest.raises(DomainError, match=message):
        register(record)
    register(Step)  # again, as when a module is loaded anew


def test_a_package_brings_its_kinds_by_an_entry_point(tmp_path: Path) -> None:
    """The command knows them without being told: a folder on the path that looks like an installed package."""
    (tmp_path / "pollen.py").write_text(
        "from typing import Literal\nimport skyscatter\nfrom skyscatter.optics.phase import HenyeyGreenstein\n"
        "@skyscatter.register\nclass Pollen(HenyeyGreenstein):\n"
        "    kind: Literal['pollen'] = 'pollen'\n    g: float = 0.8\n"
    )
    about = tmp_path / "pollen-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: pollen\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[skyscatter.kinds]\npollen = pollen\n")
    text = SKY.replace("half-and-half", "pollen").replace('kind = "step", top = 1e4', 'kind = "uniform", top = 1e4')
    text = text[: text.rindex("[[components]]")]
    (tmp_path / "sky.toml").write_text(text)
    code = (
        "import sys; sys.path.insert(0, sys.argv.pop(1))\n"
        "from skyscatter.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    words = [sys.executable, "-c", code, str(tmp_path), "models", "check", str(tmp_path / "sky.toml")]
    done = subprocess.run(words, capture_output=True, text=True)
    assert "good (1 components" in done.stdout, done.stderr
