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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from typing import Annotated, TextIO

import typer
from pydantic import ValidationError

import skyscatter
from skyscatter.atomic import explained
from skyscatter.cli import dehaze, flux, info, invert, models, nebula, render, sky, stopping, store, view, warm
from skyscatter.cli.examples import epilog
from skyscatter.errors import ConvergenceError, DomainError, ModelFileError, SkyscatterError
from skyscatter.problems import problem_lines

app = typer.Typer(
    name="skyscatter",
    help="Light scattering in planetary atmospheres: skies as spectra, pictures and numbers with error bars.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("sky", epilog=epilog("sky"))(sky.sky)
app.command("flux", epilog=epilog("flux"))(flux.flux)
app.command("view", epilog=epilog("view"))(view.view)
app.command("nebula", epilog=epilog("nebula"))(nebula.nebula)
app.command("render", epilog=epilog("render"))(render.render)
app.command("dehaze", epilog=epilog("dehaze"))(dehaze.dehaze)
app.command("invert", epilog=epilog("invert"))(invert.invert)
app.add_typer(models.app, name="models", epilog=epilog("models"))
app.add_typer(store.app, name="store", epilog=epilog("store"))
app.command("warm", epilog=epilog("warm"))(warm.warm)
app.command("info", epilog=epilog("info"))(info.info)


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
