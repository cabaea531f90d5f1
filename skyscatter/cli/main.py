"""``skyscatter``: the program and what its exit status means.

Exit status: 0 done, 1 an error in skyscatter itself, 2 something in the command or its files is wrong, 3 a numerical
method has not converged (what was found is written), 130 interrupted by Ctrl-C, 143 by SIGTERM.  Errors are one line
on stderr.
"""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from itertools import pairwise
from typing import Annotated, Any, TextIO

import typer
from pydantic import ValidationError
from typer.core import TyperGroup

import skyscatter
from skyscatter.atomic import explained
from skyscatter.cli import stopping
from skyscatter.cli.examples import epilog
from skyscatter.errors import ConvergenceError, DomainError, ModelFileError, SkyscatterError
from skyscatter.problems import problem_lines

#: Commands in the order of the help, each in a module of its name with a function, or a group `app`, of that name.
COMMANDS = (
    "sky", "view", "flux", "export", "nebula", "render", "dehaze", "invert", "models", "store", "warm", "info",
)  # fmt: skip


@cache
def _command(name: str) -> Any:
    """A command or group of commands, loaded from its module."""
    module = import_module(f"skyscatter.cli.{name}")
    parts = typer.Typer(add_completion=False, rich_markup_mode=None)
    if hasattr(module, "app"):
        parts.add_typer(module.app, name=name, epilog=epilog(name))
        return typer.main.get_group(parts).commands[name]
    parts.command(name, epilog=epilog(name))(getattr(module, name))
    return typer.main.get_command(parts)


class _Commands(Mapping[str, Any]):
    """The commands, each loaded when it is asked for: one of them begins without what the others need."""

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)

    def __contains__(self, name: object) -> bool:
        return name in COMMANDS

    def __getitem__(self, name: str) -> Any:
        if name not in COMMANDS:
            raise KeyError(name)
        return _command(name)


def _door(words: list[str]) -> str:
    """The command that words name; that for skies or nebulae where ``render`` is to render one."""
    if words[0] == "render":
        from skyscatter.models.files import load_model, model_names

        shipped = model_names()
        for word in words[1:]:
            if word in shipped or word.endswith(".toml"):
                with suppress(SkyscatterError, ValidationError, OSError):  # the command says what is wrong with it
                    return str(load_model(word).command)
    return words[0]


class _Program(TyperGroup):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Commands()  # type: ignore[assignment]

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command to run, its name and its words."""
        return super().resolve_command(ctx, [_door(args), *args[1:]])


app = typer.Typer(
    name="skyscatter",
    cls=_Program,
    help="Light scattering in planetary atmospheres: skies as spectra, pictures and numbers with error bars.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"skyscatter {skyscatter.__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Light scattering in planetary atmospheres: skies as spectra, pictures and numbers with error bars."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns the exit status (the console script hands it to the shell)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    warnings.showwarning = _warn
    try:
        _check_json(arguments)
        with _log_on_stderr():
            result = app(args=arguments, prog_name="skyscatter", standalone_mode=False, obj=arguments)
        sys.stdout.flush()  # here, where a full disk can still be spoken of
    except (KeyboardInterrupt, typer.Abort):
        return _say("interrupted", stopping.status())
    except Exception as error:
        if stopping.asked():  # libraries make errors of their own of it, such as of an import that was cut short
            return _say("interrupted", stopping.status())
        return _failed(error)
    return result if isinstance(result, int) else 0


def _failed(error: Exception) -> int:
    """Say what is wrong; returns the exit status."""
    try:
        raise error
    except ValidationError as error:
        for problem in problem_lines(error):
            _say(f"error: {problem}", 2)
        return 2
    except ConvergenceError as error:
        return _say(f"error: {error}", 3)
    except SkyscatterError as error:
        for problem in str(error).splitlines() if isinstance(error, ModelFileError) else [str(error)]:
            _say(f"error: {problem}", 2)
        return 2
    except BrokenPipeError:
        # The reader of our output went away; nothing more can be said to it.
        _silence_stdout()
        return 1
    except OSError as error:
        if error.filename is None:
            _silence_stdout()
        return _say(f"error: {explained(error)}", 2)
    except MemoryError:
        return _say("error: not enough memory; ask for fewer pixels, wavelengths or cells", 2)
    except RecursionError:
        return _say("error: something in the input is nested too deep; make it flatter", 2)
    except Exception as error:
        if hasattr(error, "format_message"):  # typer's usage errors, whose classes moved between its versions
            context = getattr(error, "ctx", None)
            if type(error).__name__ == "NoArgsIsHelpError":
                typer.echo(context.get_help() if context else "", err=True)
                return 2
            path = context.command_path if context else "skyscatter"
            return _say(f"error: {error.format_message()} (see {path} --help)", 2)
        if os.environ.get("SKYSCATTER_TRACEBACK"):
            raise
        return _say(
            f"internal error: {type(error).__name__}: {error} (SKYSCATTER_TRACEBACK=1 shows where; please report it)", 1
        )


def _silence_stdout() -> None:
    """Let what is still to be written to stdout vanish, so that the end of the process does not fail on it."""
    with suppress(OSError, ValueError):  # tests have no file behind stdout
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _check_json(arguments: Sequence[str]) -> None:
    """``--json`` is a flag in all commands; what looks like a file after it would be taken for an argument."""
    for word, following in pairwise([*arguments, ""]):
        looks_like_file = following == "-" or following.lower().endswith(".json")
        if word.startswith("--json=") or (word == "--json" and looks_like_file):
            file = word.partition("=")[2] or following
            raise DomainError("json", file, "--json takes no file, it prints on stdout; write --json > FILE")


class _Stderr(logging.StreamHandler[TextIO]):
    """Lines on what stderr is at the time, which a progress bar replaces."""

    def emit(self, record: logging.LogRecord) -> None:
        self.stream = sys.stderr
        super().emit(record)


@contextmanager
def _log_on_stderr() -> Iterator[None]:
    """Show what the log says; `common.talk` chooses how much."""
    log, handler = logging.getLogger("skyscatter"), _Stderr()
    handler.setFormatter(_Words())
    log.addHandler(handler)
    before, log.propagate = log.level, False
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.propagate = True
        log.setLevel(before)


class _Words(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        kind = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        return f"skyscatter: {kind}{' '.join(record.getMessage().split())}"


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """What skyscatter warns of as one line; of other libraries nothing that a user of a command could act on."""
    if issubclass(category, UserWarning):
        print(f"skyscatter: warning: {' '.join(str(message).split())}", file=sys.stderr)


def _say(text: str, status: int) -> int:
    print(f"skyscatter: {' '.join(text.split())}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
