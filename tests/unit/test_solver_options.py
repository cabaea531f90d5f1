"""Options of solvers: one record each, from which Python's checks and the commands' options are made."""

from __future__ import annotations

import dataclasses
import inspect
import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import typer

import skyscatter
from skyscatter.cli.main import app, main
from skyscatter.errors import DomainError
from skyscatter.solvers import path as shells
from skyscatter.solvers import photons, surface_path, volume_path
from skyscatter.solvers.options import RECORDS, About, record_of

FIELDS = sorted({name for record in RECORDS.values() for name in record.about()})


class Command(NamedTuple):
    """A command with options of solvers: its words, its solvers, and what it takes where the solvers take else."""

    words: list[str]
    solvers: tuple[str, ...]
    named: bool = True  #: whether it has --solver
    others: tuple[str, ...] = ()  #: options of the same names that are of something else
    usual: dict[str, str] = {}  # noqa: RUF012 - nothing changes it


COMMANDS = {
    "sky": Command(["earth", "-o", "out.png"], ("orders", "path", "single")),
    "nebula": Command(["ring-nebula", "-o", "out.png"], ("path", "single", "photons")),
    "render": Command(["fog-room", "-o", "out.png"], ("path", "photons")),
    "flux": Command(["earth", "-o", "out.nc"], ("orders",), named=False),
    "export": Command(["earth"], ("orders",), named=False, usual={"tolerance": "0.01"}),
    # The noise is that of the data, the seed that of walks through the posterior as well.
    "invert": Command(
        ["earth", "--free", "haze.optical_depth=0:1"], ("orders", "path", "single"), others=("noise", "seed"),
        usual={"samples": "256"},
    ),
}  # fmt: skip


def offered(command: str) -> list[str]:
    """Options of a command that are fields of records."""
    names = inspect.signature(getattr(import_module(f"skyscatter.cli.{command}"), command)).parameters
    return [name for name in names if name in FIELDS and name not in COMMANDS[command].others]


OFFERED = [
    (command, solver, name)
    for command, about in COMMANDS.items()
    for name in offered(command)
    for solver in about.solvers
]
HAVING = [(command, solver, name) for command, solver, name in OFFERED if name in RECORDS[solver].about()]
LACKING = [case for case in OFFERED if case not in HAVING and COMMANDS[case[0]].named]


def wrong(about: About) -> tuple[str, Any]:
    """A value out of the range, as it is typed and as it is."""
    if about.kind == "name":
        return "nonsense", "nonsense"
    if about.kind == "length":
        return "-1m", -1.0
    return (str(int(about.low) - 1), int(about.low) - 1) if about.kind == "whole" else ("200%", 2.0)


def right(about: About) -> str:
    """A value within the range, as it is typed."""
    kinds = {"name": about.choices[:1] or ("",), "length": ("1m",), "whole": ("8",), "share": ("5%",)}
    return kinds[about.kind][0]


def option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def test_every_field_is_an_option_of_some_command() -> None:
    assert {(solver, name) for _, solver, name in HAVING} == {
        (solver, name) for solver, record in RECORDS.items() for name in record.about()
    }


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_ranges_and_usual_values(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    help_text = "".join(capsys.readouterr().out.split())  # lines end anywhere
    for _, solver, name in (case for case in HAVING if case[0] == command):
        about = RECORDS[solver].about()[name]
        said = help_text[help_text.index(option(name)) :]
        usual = COMMANDS[command].usual.get(name, about.usual)
        for words in (about.help, about.rule[1:], f"else {usual}."):
            assert "".join(words.split()) in said, (solver, name, words)


@pytest.mark.parametrize(("command", "solver", "name"), HAVING)
def test_a_value_out_of_range_is_refused_by_the_same_line(
    command: str, solver: str, name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    about = RECORDS[solver].about()[name]
    if about.kind == "switch":
        with pytest.raises(DomainError, match=f"{name} = 3: True or False"):
            record_of(solver, **{name: 3})
        return  # a switch that is typed has no value
    typed, value = wrong(about)
    with pytest.raises(DomainError) as error:
        record_of(solver, **{name: value})
    named = ["--solver", solver] if COMMANDS[command].named else []
    assert main([command, *COMMANDS[command].words, *named, option(name), typed]) == 2
    assert capsys.readouterr().err == f"skyscatter: error: {error.value}\n"
    assert str(error.value) == f"{name} = {value!r}: {about.rule}"


@pytest.mark.parametrize(("command", "solver", "name"), LACKING)
def test_what_means_nothing_to_the_solver_is_refused(
    command: str, solver: str, name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    abouts = {one: RECORDS[one].about() for one in COMMANDS[command].solvers}
    able = [one for one in abouts if name in abouts[one] and not abouts[one][name].seldom]
    about = abouts[able[0]][name]
    typed = [] if about.kind == "switch" else [right(about)]
    assert main([command, *COMMANDS[command].words, "--solver", solver, option(name), *typed]) == 2
    words = f"means nothing to the solver {solver}; leave it out, or add --solver {able[0]}\n"
    line = capsys.readouterr().err
    assert line.startswith(f"skyscatter: error: {name} = ")
    assert line.endswith(words)
    with pytest.raises(TypeError, match=name):
        record_of(solver, **{name: 8})


def test_choices_are_those_that_the_solvers_know() -> None:
    ways = {*shells.SAMPLINGS, *volume_path.SAMPLINGS, *surface_path.SAMPLINGS} - {None}
    assert set(skyscatter.Path.about()["sampling"].choices) == ways
    assert set(skyscatter.Path.about()["transmittance"].choices) == set(volume_path.TRANSMITTANCES)
    assert set(skyscatter.Photons.about()["estimator"].choices) == set(photons.ESTIMATORS)


def test_the_shell_offers_choices() -> None:
    command = typer.main.get_command(app).commands["nebula"]  # type: ignore[attr-defined]
    context = command.make_context("nebula", ["ring-nebula"], resilient_parsing=True)
    parameters = {parameter.name: parameter for parameter in command.params}
    for name, typed, offered_words in (
        ("estimator", "p", ["points", "paths"]),
        ("transmittance", "r", ["ratio", "residual-ratio"]),
        ("samples", "1", []),
    ):
        assert [item.value for item in parameters[name].shell_complete(context, typed)] == offered_words


def test_numbers_of_numpy_are_numbers_and_truth_is_none() -> None:
    how = skyscatter.Path(samples=np.int64(8), tolerance=np.float64(1e-3))  # type: ignore[arg-type]
    assert how == skyscatter.Path(samples=8, tolerance=1e-3)
    assert json.loads(json.dumps(how.recorded)) == {"seed": 0, "samples": 8, "tolerance": 1e-3}
    for wrong_one in (True, 8.0, "8", 2**63):
        with pytest.raises(DomainError, match="a whole number"):
            skyscatter.Path(samples=wrong_one)  # type: ignore[arg-type]


def test_records_are_frozen_and_changed_copies_are_checked() -> None:
    how = skyscatter.Path(samples=8)
    with pytest.raises(dataclasses.FrozenInstanceError):
        how.samples = 9  # type: ignore[misc]
    with pytest.raises(DomainError, match="samples = 8: give samples or noise, not both"):
        dataclasses.replace(how, noise=0.1)
    assert record_of(how) is how


@pytest.mark.parametrize("record", RECORDS.values(), ids=str)
def test_docstrings_name_every_field(record: Any) -> None:
    text = " ".join((inspect.getdoc(record) or "").split())
    for name, about in record.about().items():
        assert f"{name} : {about.type}, optional {about.help}. {about.range}" in text


def test_recipes_hold_what_was_given() -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30)
    camera = skyscatter.Panorama(width=2, height=1)
    made = skyscatter.render(scene, camera, [550], solver="single").recipe
    assert (made["solver"], made["options"]) == ("single", {"seed": 0})
    walks = skyscatter.Path(samples=20, max_order=2)
    made = skyscatter.render(scene, camera, [550], solver=walks, orders=1, parts=True).recipe
    given = {"seed": 0, "samples": 32, "max_order": 2, "orders": 1, "parts": True}  # whole batches of walks
    assert (made["solver"], made["options"]) == ("path", given)
    assert skyscatter.Photons(direct=False).recorded == {"seed": 0, "direct": False}


def test_a_seed_that_nothing_would_use_is_refused_in_a_sequence(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["sky", "earth-simple", "--sun-elevations", "30,40", "--seed", "3", "--size", "4x2", "-o", "a.png"]
    assert main(words) == 2
    assert "seed = 3: means nothing to the solver orders without an eclipse" in capsys.readouterr().err


def test_records_load_nothing_heavy() -> None:
    code = "import sys, skyscatter; skyscatter.Path(samples=8); sys.exit(len({'numpy', 'numba'} & {*sys.modules}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
