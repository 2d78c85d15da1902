"""The control of units that work for several clocks on one set of operands."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from amaranth.hdl import Module, Signal, Value

from kalmanhdl.rtl.shapes import fitted


@dataclass(frozen=True, slots=True)
class Iteration:
    """A state that is loaded by ``start`` and advanced once in each of so many ``clocks``.

    Operands are taken in the cycle in which ``start`` is high. ``latency`` cycles later ``done`` is high for
    that cycle, and the result stands from then on until the cycle of the next start, which may be the same. A
    start before that gives up what was begun.
    """

    clocks: int

    @property
    def latency(self) -> int:
        """Cycles from a start to its result, and from a start to the next at least."""
        return self.clocks + 1

    def built(
        self,
        m: Module,
        start: Value,
        done: Value,
        loaded: Mapping[str, Value],
        advanced: Callable[[Module, dict[str, Value]], dict[str, Value]],
    ) -> dict[str, Value]:
        """The registers of the state, which ``start`` loads; ``done`` is driven."""
        state = {
            name: Signal(value.shape(), name=f"held_{name}", reset_less=True)
            for name, value in loaded.items()
        }
        following = advanced(m, dict(state))
        left = Signal(range(self.clocks + 1))
        finished = Signal()
        m.d.sync += finished.eq((left == 1) & ~start)
        m.d.comb += done.eq(finished)
        with m.If(start):
            m.d.sync += left.eq(self.clocks)
            m.d.sync += [held.eq(loaded[name]) for name, held in state.items()]
        with m.Elif(left != 0):
            m.d.sync += left.eq(left - 1)
            m.d.sync += [
                held.eq(fitted(following[name], len(held), False))
                for name, held in state.items()
                if following[name] is not held
            ]
        return dict(state)
