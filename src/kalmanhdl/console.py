"""What a command says besides its result: progress and errors on stderr, and how it ends.

Nothing else of the package prints, but the commands themselves.
"""

import functools
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, ParamSpec, Self, TextIO

import typer

from kalmanhdl.errors import FormatError, KalmanhdlError, ScheduleError, VerificationError
from kalmanhdl.interruption import INTERRUPTED, Interrupted
from kalmanhdl.validation import KalmanhdlWarning

FAILED, DEFECT = 1, 70

_P = ParamSpec("_P")


def reported(command: Callable[_P, None]) -> Callable[_P, None]:
    """A command whose errors end as one line on stderr and an exit code."""

    @functools.wraps(command)
    def run(*args: _P.args, **kwargs: _P.kwargs) -> None:
        _show_warnings()
        try:
            command(*args, **kwargs)
        except (Interrupted, KeyboardInterrupt):
            _end("interrupted", INTERRUPTED)
        except KalmanhdlError as error:
            _end(f"error: {_place(kwargs, error)}{error}", FAILED)
        except BrokenPipeError:
            # Whoever read the result has enough of it.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(FAILED) from None
        except MemoryError:
            _end("error: out of memory: the design or its data are too large for this machine", FAILED)
        except OSError as error:
            place = f"{str(error.filename)[:200]}: " if error.filename else ""
            _end(f"error: {place}{error.strerror or error}", FAILED)
        except (typer.Exit, typer.BadParameter):
            raise
        except Exception as error:
            if os.environ.get("KALMANHDL_DEBUG"):
                raise
            problem = f"{type(error).__name__}: {error}"
            _end(f"error: a defect of kalmanhdl: {problem} (KALMANHDL_DEBUG=1 shows where)", DEFECT)

    return run


# What later stages than the reader of a design file find wrong with the design in their hands.
_OF_THE_DESIGN = (FormatError, ScheduleError, VerificationError)


def _place(arguments: Mapping[str, object], error: KalmanhdlError) -> str:
    """Where the design file of a command says what a later stage than its reader could not accept."""
    # Imports pydantic, which nobody else needs who asks for help.
    from kalmanhdl.design_file.lines import line_of

    path = arguments.get("design") or arguments.get("path")
    if not isinstance(path, Path) or not (error.key or error.table or isinstance(error, _OF_THE_DESIGN)):
        return ""
    file = path / "design.toml" if path.is_dir() else path
    if not file.is_file():
        return ""
    line = line_of(file.read_text(encoding="utf-8"), error.table, error.key)
    return f"{file}: " if line is None else f"{file}, line {line}: "


def _end(line: str, code: int) -> None:
    typer.echo(" ".join(line.split()), err=True)
    raise typer.Exit(code) from None


def _show_warnings() -> None:
    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        typer.echo(" ".join(f"warning: {message}".split()), err=True)

    # Numbers that overflow while a model is examined end in a message of their own.
    warnings.simplefilter("ignore")
    warnings.simplefilter("always", KalmanhdlWarning)
    warnings.showwarning = show


class Progress:
    """Stages on stderr as they begin: with a clock that runs on a terminal, plain lines elsewhere."""

    def __init__(self) -> None:
        self._begin = time.perf_counter()
        self._live: Any = None
        # The stage that each thread is at.
        self._tasks: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import Progress as Live
            from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

            columns = (SpinnerColumn("line"), TimeElapsedColumn(), TextColumn("{task.description}"))
            self._live = Live(*columns, console=Console(stderr=True))
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            for task in self._tasks.values():
                self._live.update(task, completed=1)
            self._live.stop()

    def __call__(self, message: str) -> None:
        """A stage begins."""
        if self._live is None:
            typer.echo(f"{time.perf_counter() - self._begin:6.1f} s  {message}", err=True)
            return
        thread = threading.get_ident()
        if thread in self._tasks:
            self._live.update(self._tasks[thread], completed=1)
        self._tasks[thread] = self._live.add_task(message, total=1)
