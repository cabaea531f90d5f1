"""What a strict type checker says of users' code: texts with units are accepted where a field takes them."""

from __future__ import annotations

from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

GOOD = """
from skyscatter.fields import Box, Sphere
from skyscatter.lights import PointStar
from skyscatter.scene import Star, Sun
from skyscatter.surfaces.materials import Lambert

ball = Sphere(radius="1 pc", position=("1 pc", 0, 0), turn_deg="0.5 rad")
area: float = ball.radius**2
x, y, z = Box(half_sizes=["1 m", 2, 3]).half_sizes
total: float = x + y + z
star = Star(temperature="4000 K", distance="0.3 AU", spectrum="blackbody")
sun = Sun(elevation_deg="30 deg", distance_au="0.3 AU")
lamp = PointStar(radius="2 Rsun", temperature="10 kK")
Lambert(albedo="30%")
Lambert(albedo={"wavelengths": [400, 700], "values": [0.1, "20%"]})
"""


@pytest.mark.parametrize(
    ("code", "complaint"),
    [
        (GOOD, None),
        ('from skyscatter.fields import Sphere\nSphere(radius=["1 pc"])\n', 'Argument "radius" to "Sphere"'),
        ("from skyscatter.fields import Sphere\nSphere(radios=1)\n", 'did you mean "radius"'),
        ("from skyscatter.scene import Star\nname: str = Star().distance\n", "Incompatible types in assignment"),
    ],
)
def test_texts_with_units_pass_a_strict_check(code: str, complaint: str | None, tmp_path: Path) -> None:
    api = pytest.importorskip("mypy.api")
    (tmp_path / "user.py").write_text(code, encoding="utf-8")
    (tmp_path / "mypy.ini").write_text("[mypy]\nstrict = true\nfollow_imports = silent\n", encoding="utf-8")
    cache = Path(tmp_path).parent / "mypy-cache"
    out, _, status = api.run(
        [str(tmp_path / "user.py"), f"--config-file={tmp_path / 'mypy.ini'}", f"--cache-dir={cache}"]
    )
    assert (status == 0) == (complaint is None), out
    assert complaint is None or complaint in out
