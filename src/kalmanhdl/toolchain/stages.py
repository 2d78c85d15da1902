"""The stages of a build: told as they begin, timed as they end."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def timed(
    seconds: dict[str, float], stage: str, progress: Callable[[str], None], message: str
) -> Iterator[None]:
    """Tell that a stage begins, and keep the seconds that it took."""
    progress(message)
    begin = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - begin
