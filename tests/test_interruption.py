"""Ctrl-C is never lost, cleans up once, and ends at once what does not end by itself."""

import os
import signal
import sys
import threading

import pytest

from kalmanhdl import interruption
from kalmanhdl.interruption import Interrupted, catch_signals


class Ended(BaseException):
    """In place of the end of the process."""


@pytest.fixture
def clock(monkeypatch):
    """The signals of a command, a clock in the test's hand, and an end that is told."""
    now = [100.0]

    def end(code):
        raise Ended(code)

    monkeypatch.setattr(interruption.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(os, "_exit", end)
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [signal.getsignal(each) for each in signals]
    catch_signals()
    yield now
    for each, handler in zip(signals, before, strict=True):
        signal.signal(each, handler)


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_is_raised_and_a_second_at_once_is_the_same_wish(clock, first):
    with pytest.raises(Interrupted):
        signal.raise_signal(first)
    clock[0] += 0.5
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize("second", [signal.SIGINT, signal.SIGTERM])
def test_a_later_signal_ends_what_swallowed_the_first(clock, second, capfd):
    with pytest.raises(Interrupted):
        signal.raise_signal(signal.SIGINT)
    clock[0] += 1.5
    with pytest.raises(Ended, match="130"):
        signal.raise_signal(second)
    assert capfd.readouterr().err == "interrupted\n"


class Finalised:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_in_a_finaliser_is_raised_after_it(clock):
    def finalise_and_go_on():
        Finalised()
        threading.Event().wait(60)

    with pytest.raises(Interrupted):
        finalise_and_go_on()


def test_other_errors_in_a_finaliser_are_told_as_before(clock, monkeypatch):
    told = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)
    catch_signals()

    class Broken:
        def __del__(self):
            raise ValueError("broken")

    Broken()
    assert [str(each.exc_value) for each in told] == ["broken"]
