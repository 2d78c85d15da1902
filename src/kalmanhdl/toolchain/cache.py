"""Results of slow programs, found again by the content of what went in.

An entry is a folder. It is made aside and published by one rename, so that an entry that exists is
whole, however many processes work at once and whenever they are killed.
"""

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from kalmanhdl.environment import cache_folder

_BYTES_KEPT = 2 * 1024**3
_SAFE_SECONDS = 3600.0
_STALE_SECONDS = 24 * 3600.0


def key(*parts: str | bytes) -> str:
    """A name that two lists of inputs share only when they are equal."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()[:40]


def find(kind: str, parts: tuple[str | bytes, ...]) -> Path | None:
    """The folder of result files for these inputs, where there is one.

    Whoever uses the files does so at once: entries that nobody has used for an hour may be evicted.
    """
    place = _place(kind, parts)
    if not place.is_dir():
        return None
    os.utime(place)
    return place


def entry(kind: str, parts: tuple[str | bytes, ...], make: Callable[[Path], None]) -> Path:
    """The folder of result files for these inputs; ``make(folder)`` fills it where there is none yet."""
    place = find(kind, parts)
    if place is None:
        place = _place(kind, parts)
        _publish(place, make)
        evict(_BYTES_KEPT)
    return place


def _place(kind: str, parts: tuple[str | bytes, ...]) -> Path:
    return cache_folder("entries") / f"{kind}-{key(*parts)}"


def _publish(place: Path, make: Callable[[Path], None]) -> None:
    folder = Path(tempfile.mkdtemp(dir=cache_folder("unfinished")))
    try:
        make(folder)
        try:
            folder.rename(place)
        except OSError:
            # Another process published the same entry meanwhile; it is as good.
            if not place.is_dir():
                raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def evict(bytes_kept: int) -> None:
    """Remove the least recently used entries beyond a size, and what killed processes left unfinished."""
    now = time.time()
    for folder in _folders(cache_folder("unfinished")):
        if now - folder.stat().st_mtime > _STALE_SECONDS:
            shutil.rmtree(folder, ignore_errors=True)
    total = 0
    for folder in sorted(_folders(cache_folder("entries")), key=_last_use, reverse=True):
        total += _size(folder)
        if total > bytes_kept and now - _last_use(folder) > _SAFE_SECONDS:
            _remove(folder)


def _remove(folder: Path) -> None:
    # Renamed first: a reader sees the whole entry or none.
    grave = cache_folder("unfinished") / f"{folder.name}-{os.getpid()}"
    try:
        folder.rename(grave)
    except OSError:
        return
    shutil.rmtree(grave, ignore_errors=True)


def _folders(parent: Path) -> list[Path]:
    return [path for path in parent.iterdir() if path.is_dir()] if parent.is_dir() else []


def _last_use(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
