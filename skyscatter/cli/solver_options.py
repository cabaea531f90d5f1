"""Options of commands for solvers, made from the records of `skyscatter.solvers.options`: help, ranges, and checks.

A command names its solvers in ``SOLVERS``, and those of their options that it has in its signature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import typer

from skyscatter.cli import parse
from skyscatter.errors import DomainError
from skyscatter.solvers.options import RECORDS, About, record_of
from skyscatter.units import metres

#: What stands for a value in the help, by the kind of the option.
METAVARS = {"whole": "N", "share": "REL", "length": "LENGTH", "name": "NAME", "switch": None}
#: Options with more names than one.
NAMES = {"max_order": ("--max-order", "--order-limit")}
#: What is asked of an answer, and the solvers that can give it.
LAYERS = {"denoise": ("path", "photons"), "orders": ("path", "photons")}


def option(name: str, solvers: Sequence[str], usual: str | None = None) -> Any:
    """The option of a command for a field of the records of some solvers.

    Parameters
    ----------
    name : str
        Of the field.
    solvers : sequence of str
        Those of the command.
    usual : str, optional
        What the command takes where nothing is given, if that is not what the solvers take.
    """
    about = next(iter(_having(name, solvers).values()))
    words = name.replace("_", "-")
    switch = (f"--{words}/--no-{words}",) if about.kind == "switch" else ()

    def complete(incomplete: str) -> list[str]:
        """What the shell offers."""
        return [choice for choice in about.choices if choice.startswith(incomplete)]

    return typer.Option(
        *switch,
        *NAMES.get(name, ()),
        metavar=METAVARS[about.kind],
        help=help_of(name, solvers, usual),
        autocompletion=complete if about.choices else None,
    )


def help_of(name: str, solvers: Sequence[str], usual: str | None = None) -> str:
    """What an option means, its range and what is taken without it; for each solver where they differ."""
    said: dict[str, list[str]] = {}
    for solver, about in _having(name, solvers).items():
        text = about.range if usual is None else about.range.replace(f"else {about.usual}.", f"else {usual}.")
        said.setdefault(f"{about.help}\0.  {text}", []).append(solver)
    alone = {text: "" if len(names) == len(solvers) else f" ({', '.join(names)})" for text, names in said.items()}
    shares = any(about.kind == "share" for about in _having(name, solvers).values())
    return "  ".join([text.replace("\0", names) for text, names in alone.items()] + ["Or in per cent: 1%."] * shares)


def _having(name: str, solvers: Sequence[str]) -> dict[str, About]:
    """What a field means, by those of the solvers that have it."""
    return {solver: RECORDS[solver].about()[name] for solver in solvers if name in RECORDS[solver].about()}


def given(solver: str, solvers: Sequence[str], **texts: Any) -> dict[str, Any]:
    """The options of a solver that were typed, by their names, as its record takes them.

    Parameters
    ----------
    solver : str
        One of the command's; ``auto`` where that is still to be seen.
    solvers : sequence of str
        All of the command's.
    **texts
        Name of a field -> what was typed; None for nothing.

    Raises
    ------
    DomainError
        For solvers that the command has not, for options that mean nothing to the chosen one, and for values that its
        record refuses.
    """
    if solver not in solvers:
        raise DomainError("solver", solver, f"choose one of {', '.join(solvers)}")
    named = [one for one in solvers if one in RECORDS]
    chosen = [solver] if solver in RECORDS else named
    found = {}
    for name, text in texts.items():
        if text is not None:
            able = _having(name, chosen)
            found[name] = value_of(name, text, able or _having(name, named))
            if not able:
                advised = [one for one, about in _having(name, named).items() if not about.seldom]
                refuse(name, found[name], solver, advised)
    record_of(suited(found, chosen)[0], **found)  # refuses what contradicts itself
    return found


def refuse(name: str, value: Any, solver: str, others: Sequence[str]) -> None:
    """Raise for an option that means nothing to a solver; `others` have a use for it."""
    rule = f"means nothing to the solver {solver}; leave it out, or add --solver {others[0]}"
    raise DomainError(name, value, rule)


def suited(options: Mapping[str, Any], solvers: Sequence[str]) -> list[str]:
    """Those of the solvers whose records have all of the options; there is one at least, or it is said what to do."""
    found = [solver for solver in solvers if set(options) <= set(RECORDS[solver].about())]
    if not found:
        last = next(name for name in reversed(list(options)) if set(_having(name, solvers)) != set(solvers))
        others = ", ".join(f"--{name.replace('_', '-')}" for name in options if name != last)
        raise DomainError(last, options[last], f"no solver knows it beside {others}; leave it out")
    return found


def value_of(name: str, text: Any, having: Mapping[str, About]) -> Any:
    """The value of an option, checked, from what was typed; by the first of the solvers that have it."""
    about = next(iter(having.values()))
    if about.kind == "length":
        value: Any = metres(text, name)
    elif about.kind in ("name", "switch"):
        value = text
    else:
        value = _whole(text) if about.kind == "whole" else parse.share(text)
        if value is None or math.isnan(value):
            raise DomainError(name, text, about.rule)
    about.check(name, value)
    return value


def _whole(text: str) -> int | None:
    """A whole number; None for anything else, and for one with more digits than are of use."""
    word = text.strip()
    digits = word.removeprefix("-")
    return int(word) if digits.isascii() and digits.isdecimal() and len(digits) < 400 else None
