"""Free parameters: priors as maps of a normal variable, names that point into models, and what they write there."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import skyscatter
from skyscatter.errors import DomainError
from skyscatter.inversion.distributions import LogNormal, LogUniform, Normal, Uniform, from_json, to_json
from skyscatter.inversion.parameters import Subject, apply, parse_free, resolve
from skyscatter.inversion.quantities import as_particles, placed
from skyscatter.spectra.table import SpectralTable, evaluate

PRIORS = {
    "uniform": (Uniform(-1.0, 3.0), stats.uniform(-1, 4)),
    "loguniform": (LogUniform(1e-3, 10.0), stats.loguniform(1e-3, 10)),
    "normal": (Normal(2.0, 0.5), stats.norm(2, 0.5)),
    "cut normal": (Normal(0.95, 0.1, 0.0, 1.0), stats.truncnorm((0 - 0.95) / 0.1, (1 - 0.95) / 0.1, 0.95, 0.1)),
    "lognormal": (LogNormal(0.2, 0.7), stats.lognorm(0.7, scale=0.2)),
}


@pytest.mark.parametrize("name", PRIORS)
def test_priors_are_quantiles_of_a_normal_variable(name: str) -> None:
    """Value, inverse and slope, beside scipy's distributions; 1e-9 is what ndtri loses in the tails."""
    prior, judge = PRIORS[name]
    for z in np.linspace(-3, 3, 13):
        value = prior.value(z)
        assert judge.ppf(stats.norm.cdf(z)) == pytest.approx(value, rel=1e-9, abs=1e-12)
        assert prior.state(value) == pytest.approx(z, abs=1e-8)
        assert prior.slope(z) == pytest.approx((prior.value(z + 1e-4) - prior.value(z - 1e-4)) / 2e-4, rel=1e-5)
    assert from_json(to_json(prior)) == prior
    low, high = prior.support
    assert all(low <= prior.value(z) <= high for z in (-50.0, 50.0))


def test_impossible_priors_are_refused() -> None:
    """One line each."""
    for make in (
        lambda: Uniform(2, 1), lambda: LogUniform(0, 1), lambda: Normal(0, 0), lambda: Normal(9, 0.1, 0, 1),
        lambda: LogNormal(-1, 1), lambda: Uniform(float("nan"), 1),
    ):  # fmt: skip
        with pytest.raises(DomainError):
            make()


SKY = {
    "haze.optical_depth": 0.3, "haze.optical_depth@440": 0.7, "haze.single_scattering_albedo": 0.8,
    "haze.asymmetry": 0.5, "haze.angstrom_exponent": 0.4, "haze.scale_height": 900.0, "haze.density.top": 2e4,
    "haze.weight": 2.0, "ground.albedo": 0.5, "ground.albedo@860": 0.2, "ozone.column_du": 250.0, "ozone.peak": 2e4,
    "air.optical_depth": 0.2, "sun.elevation_deg": 12.0, "star.temperature": 5000.0, "components.haze.weight": 0.5,
}  # fmt: skip


@pytest.mark.parametrize("name", SKY)
def test_what_is_written_is_read_back(name: str) -> None:
    """Of every sort of name; tables keep the value at the reference wavelength to 1e-6."""
    subject = Subject(skyscatter.load_model("earth-hazy"), {"elevation_deg": 30.0})
    parameter = resolve(name, None, subject)
    new = parameter.put(subject, SKY[name])
    assert parameter.get(new) == pytest.approx(SKY[name], rel=1e-6)
    assert parameter.get(subject) != pytest.approx(SKY[name], rel=1e-3)
    new.model.scene(30.0)  # still a model


def test_optical_depth_is_what_the_solvers_see() -> None:
    """The written depth beside the integral along the vertical."""
    model = skyscatter.load_model("earth-maritime")
    subject = Subject(model)
    new = resolve("sea salt.optical_depth", None, subject).put(subject, 0.4).model
    scene = new.scene(30.0)
    top = scene.observer.position + np.array([0, 0, scene.medium.top])
    depth = skyscatter.optical_depth(scene, scene.observer.position, top, [550.0], by_component=True)
    assert depth[2, 0] == pytest.approx(0.4, rel=1e-9)


def test_tables_keep_their_shape() -> None:
    """Logits of albedos move by one distance; none leaves its bounds."""
    model = skyscatter.load_model("earth-hazy")
    subject = Subject(model)
    old = model.components[2].optics.single_scattering_albedo
    table = resolve("haze.single_scattering_albedo", None, subject).put(subject, 0.999).model.components[2].optics
    new = table.single_scattering_albedo

    def logit(values: tuple[float, ...]) -> np.ndarray:
        return np.log(values) - np.log1p(-np.array(values))

    shift = logit(new.values) - logit(old.values)
    assert max(new.values) < 1
    assert np.ptp(shift) < 1e-6
    assert shift[0] > 1


def test_amounts_are_written_last() -> None:
    """An exponent about another wavelength than that of the depth does not spoil the depth, in either order."""
    subject = Subject(skyscatter.load_model("earth-simple"))  # its aerosol is stated at 1000 nm
    names = ["aerosol.optical_depth", "aerosol.angstrom_exponent"]
    for order in (names, names[::-1]):
        parameters = [resolve(name, None, subject) for name in order]
        values = {"aerosol.optical_depth": 0.2, "aerosol.angstrom_exponent": 2.0}
        new = apply(parameters, subject, [values[name] for name in order])
        assert [p.get(new) for p in parameters] == pytest.approx([values[name] for name in order], rel=1e-12)


def test_mie_sizes_scale_together() -> None:
    """Effective radius of two modes; the cuts go along."""
    subject = Subject(skyscatter.load_model("earth-maritime"))
    parameter = resolve("sea salt.effective_radius", None, subject)
    old = subject.model.components[2].optics.modes
    new = parameter.put(subject, 2 * parameter.get(subject)).model.components[2].optics.modes
    assert [m.median_radius for m in new] == pytest.approx([2 * m.median_radius for m in old])
    assert [m.max_radius for m in new] == pytest.approx([2 * m.max_radius for m in old])


def test_dust_becomes_particles_with_the_same_optics() -> None:
    """At the nodes of its table exactly; then albedo, asymmetry and extinction can be set."""
    model = skyscatter.load_model("reflection-nebula")
    component = model.components[0]
    wl = [449.781, 550.0, 700.0]
    column = component.density.reference_column()
    _, particles = as_particles(component, "dust.albedo")
    before, after = (o.coefficients(wl, column) for o in (component.optics, particles))
    # Between nodes 2 % apart the one is linear in logarithms and the other is not.
    np.testing.assert_allclose(after.scattering, before.scattering, rtol=1e-3)
    np.testing.assert_allclose(after.absorption, before.absorption, rtol=1e-3)
    subject = Subject(model)
    values = {"dust.extinction": 3.0, "dust.albedo": 0.5, "dust.asymmetry": 0.3, "star.temperature": 9000.0,
              "star.position.x": 1e15, "view.inclination_deg": 70.0}  # fmt: skip
    bounds = {"star.position.x": (-1e16, 1e16)}
    parameters = [resolve(name, bounds.get(name), subject) for name in values]
    new = apply(parameters, subject, list(values.values()))
    assert [p.get(new) for p in parameters] == pytest.approx(list(values.values()), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "prior", "words"),
    [
        ("hase.optical_depth", None, "did you mean haze?"),
        ("haze.optical_dept", None, "did you mean optical_depth?"),
        ("haze", None, "haze.optical_depth"),
        ("ground.albdo", None, "did you mean albedo?"),
        ("haze.optics.phase.g", None, "not a number but a SpectralTable"),
        ("haze.effective_radius", None, "only optics of kind mie"),
        ("ozone.asymmetry", None, "have no such number"),
        ("sun.elevation_deg", None, "more than one Sun"),
        ("haze.single_scattering_albedo", (0, 2), "lies between 0 and 1"),
        ("haze.optical_depth", (3, 1), "the lower bound comes first"),
        ("haze.optical_depth@blue", None, "wavelength in nm"),
        ("haze.scale_height@440", None, "does not depend on wavelength"),
        ("haze.optical_depth", "much", "give (low, high)"),
    ],
)
def test_errors_say_what_would_do(name: str, prior: object, words: str) -> None:
    """One line with the remedy."""
    subject = Subject(skyscatter.load_model("earth-hazy"))
    with pytest.raises(DomainError) as caught:
        resolve(name, prior, subject)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_texts_of_the_command_line() -> None:
    """Bounds, means with deviations, named priors, units; and what is none of them."""
    assert parse_free("haze.optical_depth") == ("haze.optical_depth", None)
    assert parse_free("a.b=0:2") == ("a.b", Uniform(0, 2))
    assert parse_free("a.scale_height = 500m:3km") == ("a.scale_height", Uniform(500, 3000))
    assert parse_free("a.b=-1.5~0.2") == ("a.b", Normal(-1.5, 0.2))
    assert parse_free("a.b=lognormal(0.1, 0.5)") == ("a.b", LogNormal(0.1, 0.5))
    for text in ("=1:2", "a.b=", "a.b=1", "a.b=1:2:3", "a.b=x:2", "a.b=gamma(1,2)", "a.b=normal(1)"):
        with pytest.raises(DomainError):
            parse_free(text)


def test_tables_of_few_nodes_meet_their_value() -> None:
    """Between two far nodes the value is not that of a node moved as far."""
    table = SpectralTable(wavelengths=(300.0, 900.0), values=(0.95, 0.2))
    for target in (0.05, 0.7, 0.99):
        assert float(evaluate(placed(table, 550.0, target, 0.0, 1.0), [550.0])[0]) == pytest.approx(target, abs=1e-12)
