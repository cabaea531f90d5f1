"""What the program says of its model files: reference, schema, files to start from."""

from __future__ import annotations

import json
import tomllib
from functools import lru_cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic import TypeAdapter, ValidationError

from skyscatter import load_model, model_names
from skyscatter.cli.main import main
from skyscatter.datafiles import models_dir
from skyscatter.models.catalogue import groups, sorts, tables
from skyscatter.models.examples import EXAMPLES, TABLES
from skyscatter.models.files import parse_model, sort_of
from skyscatter.models.kinds import SORTS
from skyscatter.models.reference import KEYS, reference, rows
from skyscatter.models.schema import model_schema
from skyscatter.models.start import model_to_edit
from skyscatter.record import Record

ROOT = Path(__file__).resolve().parents[2]

Validator = jsonschema.Draft7Validator
KINDS = [(title, kind) for title, kinds in groups().items() for kind in kinds]


@lru_cache
def whole_page() -> str:
    return reference()


def example(text: str) -> dict[str, object]:
    return dict(tomllib.loads(f"it = {text}")["it"])


def test_the_page_is_up_to_date() -> None:
    page = (ROOT / "docs" / "model-file.md").read_text(encoding="utf-8")
    assert page == whole_page(), "run: skyscatter models reference -o docs/model-file.md"


@pytest.mark.parametrize(("title", "kind"), KINDS)
def test_every_kind_has_an_example_that_loads_and_stands_on_the_page(title: str, kind: str) -> None:
    text = EXAMPLES[title][kind]
    made = groups()[title][kind].model_validate(example(text))
    assert getattr(made, "kind", None) == kind
    assert f"### {kind}\n" in whole_page()
    assert f"{KEYS[title]} = {text}\n" in whole_page()


def test_examples_are_of_what_there_is() -> None:
    assert {title: set(kinds) for title, kinds in EXAMPLES.items()} == {t: set(k) for t, k in groups().items()}
    assert set(TABLES) == {record.__name__ for record in tables()}


@pytest.mark.parametrize("record", tables(), ids=lambda record: record.__name__)
def test_every_table_has_an_example_that_loads(record: type[Record]) -> None:
    assert TypeAdapter(record).validate_python(example(TABLES[record.__name__]))


def test_every_field_is_explained() -> None:
    records = [*sorts().values(), *tables(), *(record for kinds in groups().values() for record in kinds.values())]
    assert [f"{record.__name__}.{row.name}" for record in records for row in rows(record) if not row.text] == []


def test_units_defaults_and_ranges_are_those_of_the_fields() -> None:
    rayleigh = {row.name: row for row in rows(groups()["optics"]["rayleigh"])}
    assert rayleigh["coefficient"][1:4] == ("coefficient [m-1]", "required", "0 or above")
    assert rayleigh["wavelength"][1:4] == ("wavelength [nm]", "550", "1e-06 to 1e+09")
    assert {row.name: row.range for row in rows(sorts()["nebula"].model_fields["view"].annotation)}["ra_deg"] == (
        "0 to below 360"
    )


def test_one_kind_is_shown_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "reference", "tabulated"]) == 0
    out = capsys.readouterr().out
    assert "| `densities` |" in out  # of the profile
    assert "| `intensities` |" in out  # of the lobe
    assert "scale_height" not in out
    assert main(["models", "reference", "tabulatd"]) == 2
    assert "did you mean tabulated?" in capsys.readouterr().err


@pytest.mark.parametrize("sort", [None, *SORTS])
def test_shipped_models_fit_the_schema(sort: str | None) -> None:
    schema = model_schema(sort)
    Validator.check_schema(schema)
    validator = Validator(schema)
    for name in model_names():
        content = tomllib.loads((models_dir() / f"{name}.toml").read_text(encoding="utf-8"))
        command = next(key for key, record in sorts().items() if record is sort_of(content))
        if sort in (None, command):
            assert [error.message[:200] for error in validator.iter_errors(content)] == []
        else:
            assert not validator.is_valid(content)


def test_fields_in_fields_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """However deep: not once for every kind that holds fields, at each of the depths; and errors in them are found."""
    field: dict[str, Any] = {"kind": "sphere", "radius": "1 pc"}
    for depth in range(8):
        field = {"kind": ("sum", "product")[depth % 2], "fields": [field, {"kind": "sphere", "radius": 1.0}]}
    validator, looks = Validator(model_schema("nebula")), []
    content = tomllib.loads((models_dir() / "dusty-disk.toml").read_text(encoding="utf-8"))
    content["components"][1]["density"] = field
    whole = Validator.descend

    def counted(*given: Any, **more: Any) -> Any:
        looks.append(None)
        return whole(*given, **more)

    monkeypatch.setattr(Validator, "descend", counted)
    assert [error.message for error in validator.iter_errors(content)] == []
    assert len(looks) < 100_000
    while "fields" in field:
        field = field["fields"][0]
    field["radius"] = -1.0
    assert not validator.is_valid(content)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("radius = 6e6", "raduis = 6e6"),
        ("radius = 6e6", "radius = -6e6"),
        ("radius = 6e6", 'radius = "wide"'),
        ('kind = "exponential", scale_height = "8 km"', 'kind = "sphere", radius = "8 km"'),
        ('scale_height = "8 km"', "altitudes = [0, 1]"),
        ("albedo = 0.3", "albedo = 1.3"),
    ],
)
def test_the_schema_refuses_what_the_program_refuses(old: str, new: str) -> None:
    good = (
        'name = "x"\nplanet = { name = "x", radius = 6e6 }\nground = { albedo = 0.3 }\n[[components]]\nname = "a"\n'
        'density = { kind = "exponential", scale_height = "8 km" }\noptics = { kind = "rayleigh-air" }\n'
    )
    validator = Validator(model_schema())
    assert validator.is_valid(tomllib.loads(good))
    bad = tomllib.loads(good.replace(old, new))
    assert not validator.is_valid(bad)
    with pytest.raises(ValueError, match="x: "):
        parse_model(bad, "x")


@pytest.mark.parametrize(("title", "kind"), KINDS)
def test_examples_fit_the_schema(title: str, kind: str) -> None:
    record = groups()[title][kind]
    schema = TypeAdapter(record).json_schema()
    jsonschema.Draft202012Validator(schema).validate(example(EXAMPLES[title][kind]))


def test_schema_goes_into_a_file(tmp_path: Path) -> None:
    assert main(["models", "schema", "sky", "-o", str(tmp_path / "sky.json")]) == 0
    assert json.loads((tmp_path / "sky.json").read_text()) == model_schema("sky")


@pytest.mark.parametrize("name", model_names())
def test_a_model_to_start_from_is_the_shipped_one(name: str) -> None:
    text = model_to_edit(name)
    assert parse_model(tomllib.loads(text), name) == load_model(name)
    assert max(len(line) for line in text.splitlines() if line.startswith("#")) <= 120


def test_what_is_left_out_can_be_put_in(tmp_path: Path) -> None:
    text = model_to_edit("earth")
    assert "# [star]" in text
    head, star = text.split("# [star]")
    lines = [line[2:] for line in star.splitlines() if line.startswith("# ") and " = " in line]
    content = tomllib.loads(f"{head}\n[star]\n" + "\n".join(lines))
    assert parse_model(content, "earth") == load_model("earth")


def test_new_does_not_replace_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "my.toml"
    assert main(["models", "new", "mars", str(path)]) == 0
    assert load_model(path) == load_model("mars")
    path.write_text("mine", encoding="utf-8")
    assert main(["models", "new", "mars", str(path)]) == 2
    assert "--force" in capsys.readouterr().err
    assert path.read_text(encoding="utf-8") == "mine"
    assert main(["models", "new", "mars", str(path), "--force"]) == 0
    assert load_model(path) == load_model("mars")
    assert main(["models", "new", "mrs", str(path), "--force"]) == 2
    assert "did you mean mars?" in capsys.readouterr().err


def test_a_record_says_what_it_refuses_in_python() -> None:
    with pytest.raises(ValidationError, match="did you mean radius"):
        sorts()["sky"].model_fields["planet"].annotation(name="x", raduis=1)  # type: ignore[misc]
