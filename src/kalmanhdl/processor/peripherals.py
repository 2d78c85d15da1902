"""What stands at the processor's handshakes, clock by clock.

Input (bhatia2012, figure 6): the peripheral raises DRDY_I with its data; the processor raises ACK_I once the
data are stored; the peripheral drops DRDY_I. Output (figure 7): the processor raises DRDY_O with its data;
the peripheral drops ACK_O, and raises it once it has them. In the paper's mode either strobe of the processor
stands for eight clocks or more: so long has a peripheral to see it. A pipelined core keeps a strobe up until
it has been answered.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from kalmanhdl.processor.core import Core


class Source(Protocol):
    """What gives the processor its input."""

    ready: bool
    """DRDY_I in this clock."""
    data: int
    """The raw number on the data lines in this clock."""

    @property
    def exhausted(self) -> bool:
        """Whether no more data will ever come."""

    def advance(self, acknowledged: bool, clocks: int) -> None:
        """Live through clocks in all of which ACK_I is as given."""

    def read(self) -> None:
        """A READ has just stored the data."""


class Sink(Protocol):
    """What takes the processor's output."""

    taken: bool
    """ACK_O in this clock."""

    def advance(self, ready: bool, clocks: int) -> None:
        """Live through clocks in all of which DRDY_O is as given."""


@dataclass(slots=True)
class BenchSource:
    """A test bench that knows the program: the next number is there at every READ."""

    tokens: Sequence[int]
    ready: bool = field(init=False)
    data: int = field(init=False)
    _next: int = -1

    def __post_init__(self) -> None:
        self.read()

    @property
    def exhausted(self) -> bool:
        """Whether every number has been read."""
        return not self.ready

    def advance(self, acknowledged: bool, clocks: int) -> None:
        """Nothing changes but by a READ."""

    def read(self) -> None:
        """The next number, or the complement of the last one where there is none."""
        self._next += 1
        self.ready = self._next < len(self.tokens)
        self.data = self.tokens[self._next] if self.ready else ~self.tokens[-1] if self.tokens else 0


@dataclass(slots=True)
class BenchSink:
    """A test bench that takes every number at once."""

    taken: bool = True

    def advance(self, ready: bool, clocks: int) -> None:
        """Nothing changes."""


@dataclass(slots=True)
class HandshakingSource:
    """A peripheral with its own time.

    Number k comes ``latencies[k]`` clocks after the one before it has gone; DRDY_I falls ``reactions[k]``
    clocks after the clock in which ACK_I is seen to rise. Without data its lines hold the complement of the
    last ones.
    """

    tokens: Sequence[int]
    latencies: Sequence[int]
    reactions: Sequence[int]
    ready: bool = False
    data: int = 0
    _next: int = 0
    _wait: int = field(init=False)
    _dropping: bool = False
    _before: bool = False

    def __post_init__(self) -> None:
        self._wait = self.latencies[0] if self.tokens else 0

    @property
    def exhausted(self) -> bool:
        """Whether every number has gone."""
        return self._next == len(self.tokens)

    def read(self) -> None:
        """It sees only ACK_I."""

    def advance(self, acknowledged: bool, clocks: int) -> None:
        """Clock by clock, as a register would."""
        for _ in range(clocks):
            rise = acknowledged and not self._before
            self._before = acknowledged
            if self.ready:
                self._hold(rise)
            elif self._next < len(self.tokens):
                if self._wait == 0:
                    self.ready, self.data = True, self.tokens[self._next]
                else:
                    self._wait -= 1

    def _hold(self, rise: bool) -> None:
        if rise and not self._dropping:
            self._dropping, self._wait = True, self.reactions[self._next]
        if not self._dropping:
            return
        if self._wait:
            self._wait -= 1
            return
        self.ready, self._dropping, self.data = False, False, ~self.data
        self._next += 1
        self._wait = self.latencies[self._next] if self._next < len(self.tokens) else 0


@dataclass(slots=True)
class HandshakingSink:
    """A peripheral with its own time.

    It drops ACK_O ``reactions[k]`` clocks after the clock in which it sees DRDY_O rise for the k-th time,
    and raises it ``latencies[k]`` clocks later; both repeat from the start.
    """

    latencies: Sequence[int]
    reactions: Sequence[int]
    taken: bool = True
    _next: int = 0
    _wait: int = 0
    _reacting: bool = False
    _before: bool = False

    def advance(self, ready: bool, clocks: int) -> None:
        """Clock by clock, as a register would."""
        for _ in range(clocks):
            rise = ready and not self._before
            self._before = ready
            if self.taken:
                self._drop(rise)
            elif self._wait:
                self._wait -= 1
            else:
                self.taken = True
                self._next = (self._next + 1) % len(self.latencies)

    def _drop(self, rise: bool) -> None:
        if rise and not self._reacting:
            self._reacting, self._wait = True, self.reactions[self._next]
        if not self._reacting:
            return
        if self._wait:
            self._wait -= 1
            return
        self.taken, self._reacting, self._wait = False, False, self.latencies[self._next]


def bench(core: Core, tokens: Sequence[int]) -> tuple[Source, Sink]:
    """What has every number and takes every number as soon as the core can give or take one."""
    if core.pipelined:
        prompt = [0] * len(tokens)
        return HandshakingSource(tokens, prompt, prompt), HandshakingSink([0], [0])
    return BenchSource(tokens), BenchSink()
