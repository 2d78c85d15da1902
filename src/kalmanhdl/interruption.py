"""Ctrl-C, and a polite request to end: raised once, cleaned up after, and never lost."""

import os
import signal
import sys
import time
from contextlib import suppress
from types import FrameType

INTERRUPTED = 130
# A signal that comes so soon after the first is the same wish: timeout, for one, sends two.
_SAME_WISH_SECONDS = 1.0
_AGAIN_SECONDS = 0.01
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """Ctrl-C, or a polite request to end."""


def catch_signals() -> None:
    """From now on the first signal raises Interrupted, and one that comes later ends the process at once.

    Where nothing can be raised, as in a finaliser, Interrupted is raised again a moment later.
    """
    first: float | None = None

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal first
        now = time.monotonic()
        if first is None:
            first = now
            raise Interrupted
        # What was begun is being cleaned up. That may hang, or Interrupted was swallowed.
        if now - first >= _SAME_WISH_SECONDS:
            with suppress(OSError):
                os.write(2, b"interrupted\n")
            os._exit(INTERRUPTED)

    # Only the main thread has signals; a command called from another one does without.
    with suppress(ValueError):
        for each in _SIGNALS:
            signal.signal(each, stop)
        if hasattr(signal, "setitimer"):
            _raise_what_was_lost()


def _raise_what_was_lost() -> None:
    report = sys.unraisablehook

    def again(number: int, frame: FrameType | None) -> None:
        raise Interrupted

    def notice(lost: "sys.UnraisableHookArgs") -> None:
        if issubclass(lost.exc_type, Interrupted):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_SECONDS)
        else:
            report(lost)

    signal.signal(signal.SIGALRM, again)
    sys.unraisablehook = notice
