"""Square roots digit by digit: non-restoring rows of one adder."""

from math import isqrt

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.rtl.iteration import Iteration
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class IterativeSquareRoot(wiring.Component):
    """The root of an unsigned integer, rounded down, ``rows`` digits a clock: the ports of an ``Iteration``.

    Ports: ``radicand`` of ``width`` bits, ``root`` with ``extra`` bits below those of the integer root.
    """

    def __init__(self, width: int, extra: int = 0, rows: int = 1) -> None:
        self.extra, self._rows = extra, rows
        digits = -(-width // 2) + extra
        self.iteration = Iteration(-(-digits // rows))
        self._digits = self.iteration.clocks * rows
        super().__init__({"start": In(1), "radicand": In(width), "done": Out(1), "root": Out(digits)})

    @property
    def latency(self) -> int:
        """Clocks from the start to the result; sooner no other may start."""
        return self.iteration.latency

    def compute(self, radicand: int) -> int:
        """The root of raw integers."""
        return isqrt(radicand << 2 * self.extra)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        pairs = fitted(self.radicand.shift_left(2 * self.extra), 2 * self._digits, False)
        loaded = {
            "pairs": pairs,
            "remainder": Const(0, self._digits + 2),
            "root": Const(0, self._digits),
        }
        state = self.iteration.built(m, self.start, self.done, loaded, self._advanced)
        m.d.comb += self.root.eq(state["root"])
        return m

    def _advanced(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        pairs, remainder, root = state["pairs"], state["remainder"], state["root"]
        width = len(remainder)
        for place in range(self._rows):
            top = len(pairs) - 2 * place
            # The remainder lies in [-2 root - 1, 2 root]: below zero the last digit was one too many.
            negative = remainder[-1]
            brought = Cat(pairs[top - 2 : top], remainder)[:width]
            by = fitted(Cat(Mux(negative, 3, 1), root), width, False) ^ (~negative).replicate(width)
            remainder = named(m, f"remainder_{place}", (brought + by + ~negative)[:width])
            root = Cat(~remainder[-1], root)[: len(root)]
        return {"pairs": pairs << 2 * self._rows, "remainder": remainder, "root": root}
