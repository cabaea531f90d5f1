"""A user's own aerosol: tables and sizes with a refractive index, against the named ones; and what is no aerosol."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.dehaze.aerosols import aerosol_components, aerosol_spectrum
from skyscatter.dehaze.forward import Atmosphere
from skyscatter.dehaze.options import split_options
from skyscatter.errors import SkyscatterError

HEAD = "wavelength_nm,extinction,single_scattering_albedo,asymmetry\n"
BIOMASS = """
kind = "mie"
modes = [{ median_radius = "0.09065 um", geometric_standard_deviation = 1.4918 }]
refractive_index_real = 1.47
refractive_index_imag = 0.0093
"""


def test_a_table_is_the_aerosol_that_it_was_made_of(tmp_path):
    """In any unit of the extinction: depth, albedo and asymmetry of the medium are those of the named one."""
    wl = np.array([440.0, 550.0, 670.0, 865.0, 1600.0])
    depth, albedo, g = aerosol_spectrum("continental", wl)
    rows = "\n".join(",".join(repr(float(v)) for v in row) for row in zip(wl, 7.3 * depth, albedo, g, strict=True))
    path = tmp_path / "own.csv"
    path.write_text(HEAD + rows)
    for mine, named in zip(aerosol_spectrum(str(path), wl), (depth, albedo, g), strict=True):
        np.testing.assert_allclose(mine, named, rtol=1e-12)
    (component,) = aerosol_components(str(path), 0.3)
    scattering, absorption, _ = component.optics.coefficients(wl, 1.0)
    np.testing.assert_allclose(component.weight * (scattering + absorption), 0.3 * depth, rtol=1e-12)
    assert split_options({"aerosol": str(path)})[1].aerosol == str(path)
    # The content of the file, not its name, tells tables of terms apart.
    before = Atmosphere(aerosol=str(path)).medium(1.0).model_dump_json()
    path.write_text(HEAD + rows.replace("440.0", "445.0"))
    assert Atmosphere(aerosol=str(path)).medium(1.0).model_dump_json() != before


def test_sizes_and_a_refractive_index(tmp_path):
    """Fine particles scatter short waves more; depth 1 at 550 nm."""
    path = tmp_path / "smoke.toml"
    path.write_text(BIOMASS)
    depth, albedo, g = aerosol_spectrum(str(path), [450.0, 550.0, 850.0])
    assert depth[1] == pytest.approx(1.0)
    assert depth[0] > 1.2 > 0.7 > depth[2]
    assert np.all((albedo > 0.8) & (albedo < 1.0) & (g > 0.4) & (g < 0.8))


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", None, "there is no such aerosol file"),
        ("a.csv", "wavelength_nm,extinction\n550,1", "needs the columns"),
        ("a.csv", HEAD + "440,1,0.9,0.6\n870,much,0.9,0.6", "is no number"),
        ("a.csv", HEAD + "600,1,0.9,0.6\n870,1,0.9,0.6", "both sides of 550 nm"),
        ("a.csv", HEAD + "440,1,1.2,0.6\n870,1,0.9,0.6", "single_scattering_albedo"),
        ("a.csv", HEAD + "440,0,0.9,0.6\n870,1,0.9,0.6", "must be above 0"),
        ("a.csv", HEAD + "870,1,0.9,0.6\n440,1,0.9,0.6", "wavelengths must increase"),
        ("a.toml", "kind = [", "is no TOML"),
        ("a.toml", "kind = 'dust'", "needs kind"),
        ("a.toml", BIOMASS + "optical_depth = 0.2", "leave it out"),
        ("a.toml", "kind = 'mie'\nmodes = []", "aerosol = "),
        ("smog", None, "or a file of your own, .csv or .toml"),
    ],
)
def test_what_is_no_aerosol_is_refused_in_one_line(tmp_path, name, text, words):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    with pytest.raises(SkyscatterError) as caught:
        split_options({"aerosol": str(path) if path.suffix else name})
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
