"""Folders and files of results, whole or not there: made aside, put in place by one rename."""

import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from kalmanhdl.errors import OutputError

MARKER = ".kalmanhdl"
"""The file by which a folder that kalmanhdl made is known."""

_LONGEST_NAME = 200
_MARKER_TEXT = "kalmanhdl made this folder, and replaces it where it is told to (--force).\n"


def check_folder(out: str | Path, *, force: bool = False) -> None:
    """Say at once what ``new_folder`` would say after the work.

    Raises:
        OutputError: there is something at ``out`` that may not be replaced, or nothing can be written there.
    """
    place = _place(out)
    _refuse(place, out, force)
    _check_parent(next(p for p in place.parents if p.exists()), out)


def check_file(path: Path, *, force: bool = False) -> None:
    """Say at once what ``new_file`` would say after the work.

    Raises:
        OutputError: there is something at ``path`` that may not be replaced, or nothing can be written there.
    """
    try:
        parent = path.parent.resolve()
        mode = _mode(path)
        there = parent.exists()
    except (OSError, ValueError, RuntimeError) as error:
        raise OutputError(f"{_named(path)}: cannot be written: {_reason(error)}") from None
    if mode is not None and stat.S_ISDIR(mode):
        raise OutputError(f"{_named(path)}: is a folder: name a file")
    if mode is not None and not stat.S_ISREG(mode):
        what = "a link: name the file itself" if stat.S_ISLNK(mode) else "no plain file: name another one"
        raise OutputError(f"{_named(path)}: is {what}")
    if mode is not None and not force:
        raise OutputError(f"{_named(path)}: exists: name another file, or replace it with --force")
    if not there:
        raise OutputError(f"{_named(path)}: no folder {path.parent}: make it, or choose another place")
    _check_parent(parent, path)


@contextmanager
def new_folder(out: str | Path, *, force: bool = False) -> Iterator[Path]:
    """A folder to fill, which becomes ``out`` when the block ends, and is gone if it fails.

    Folders above ``out`` are made. With ``force`` a folder that kalmanhdl made is replaced, no other one.

    Raises:
        OutputError: there is something at ``out`` that may not be replaced, or it cannot be written.
    """
    check_folder(out, force=force)
    place = _place(out)
    missing = [parent for parent in place.parents if not parent.exists()]
    token = secrets.token_hex(4)
    aside = place.with_name(f".{place.name[:64]}.{token}.unfinished")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        aside.mkdir()
        yield aside
        (aside / MARKER).write_text(_MARKER_TEXT, encoding="utf-8")
        _refuse(place, out, force)
        _publish(aside, place, token)
    except OSError as error:
        raise OutputError(f"{_named(out)}: cannot be written: {_reason(error)}") from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)
        if not place.exists():
            _remove_empty(missing)


@contextmanager
def new_file(path: Path, *, force: bool = False) -> Iterator[Path]:
    """A file to write, which takes its place when the block ends, and is gone if it fails.

    With ``force`` a file is replaced.

    Raises:
        OutputError: there is something at ``path`` that may not be replaced, or it cannot be written.
    """
    check_file(path, force=force)
    aside = path.with_name(f".{secrets.token_hex(4)}.unfinished{path.suffix}")
    try:
        yield aside
        check_file(path, force=force)
        aside.replace(path)
    except (OSError, ValueError) as error:
        raise OutputError(f"{_named(path)}: cannot be written: {_reason(error)}") from error
    finally:
        with suppress(OSError, ValueError):
            aside.unlink(missing_ok=True)


def _mode(path: Path) -> int | None:
    """What there is at a path, a link as such; None where there is nothing."""
    try:
        return os.lstat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return None


def _check_parent(parent: Path, out: str | Path) -> None:
    """Whether something can be made in a folder: tried, as permissions are not all that it may lack."""
    if not parent.is_dir():
        raise OutputError(f"{_named(out)}: {parent} is no folder: choose another place")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise OutputError(f"{_named(out)}: cannot be written: no permission to write in {parent}")
    try:
        tempfile.TemporaryFile(dir=parent).close()
    except OSError as error:
        problem = f"nothing can be made in {parent} ({_reason(error)}): choose another place"
        raise OutputError(f"{_named(out)}: cannot be written: {problem}") from None


def _place(out: str | Path) -> Path:
    try:
        place = Path(out).expanduser().absolute()
        link = place.is_symlink()
        # As the system sees it, so that "results/.." is no name of a folder to be made.
        place = place.parent.resolve() / place.name if place.name != ".." else place.resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise OutputError(f"{_named(out)}: is no name of a folder: {_reason(error)}") from None
    if link:
        raise OutputError(f"{_named(out)}: is a link: name the folder itself")
    if not place.name:
        raise OutputError(f"{_named(out)}: cannot be replaced: name a folder in it")
    return place


def _refuse(place: Path, out: str | Path, force: bool) -> None:
    try:
        os.lstat(place)
        empty = place.is_dir() and not any(place.iterdir())
    except (FileNotFoundError, NotADirectoryError):
        return
    except (OSError, ValueError) as error:
        raise OutputError(f"{_named(out)}: cannot be written: {_reason(error)}") from None
    if not place.is_dir():
        raise OutputError(f"{_named(out)}: is a file: name a folder that is not there yet")
    if Path.cwd().is_relative_to(place):
        raise OutputError(f"{_named(out)}: is the working folder: name a folder in it")
    if not force:
        raise OutputError(f"{_named(out)}: exists: name another folder, or replace it with --force")
    if not empty and not (place / MARKER).is_file():
        raise OutputError(
            f"{_named(out)}: was not made by kalmanhdl (it has no file {MARKER}), so that --force does not "
            "replace it: name another folder"
        )


def _publish(aside: Path, place: Path, token: str) -> None:
    old = place.with_name(f".{place.name[:64]}.{token}.old")
    replaced = place.exists()
    if replaced:
        place.rename(old)
    try:
        aside.rename(place)
    except BaseException:
        if replaced:
            old.rename(place)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _remove_empty(folders: list[Path]) -> None:
    """Undo the making of folders, the innermost first."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def _named(out: str | Path) -> str:
    name = repr(str(out))[1:-1] or "''"
    return name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}..."


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
