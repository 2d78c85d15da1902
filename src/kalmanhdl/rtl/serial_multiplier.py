"""Products by shifting and adding: a few Booth rows used again and again."""

from amaranth.hdl import Cat, Const, Module, Shape, Value, signed, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.product_structure import recodes_first, serial_rows
from kalmanhdl.rtl.iteration import Iteration
from kalmanhdl.rtl.multiplier import booth_row
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class SerialMultiplier(wiring.Component):
    """The product ``a * b``, ``rows`` radix-4 digits of the shorter operand a clock.

    Ports: ``a``, ``b``, ``product``, and those of an ``Iteration``.
    """

    def __init__(self, a: Shape, b: Shape, rows: int = 1) -> None:
        self._rows = rows
        self._swapped = recodes_first(a.width, a.signed, b.width, b.signed)
        self.iteration = Iteration(-(-serial_rows(a.width, a.signed, b.width, b.signed) // rows))
        self._digits = self.iteration.clocks * rows
        shape = signed if a.signed or b.signed else unsigned
        ports = {"a": In(a), "b": In(b), "product": Out(shape(a.width + b.width))}
        super().__init__(ports | {"start": In(1), "done": Out(1)})

    @property
    def latency(self) -> int:
        """Clocks from the start to the result; sooner no other may start."""
        return self.iteration.latency

    def compute(self, a: int, b: int) -> int:
        """The product of raw integers."""
        return a * b

    def elaborate(self, platform: object) -> Module:
        m = Module()
        a, b = (self.b, self.a) if self._swapped else (self.a, self.b)
        loaded = {
            "multiplicand": a,
            # The digits to come, with the bit below them; the product's low bits take their place.
            "low": Cat(Const(0, 1), fitted(b, 2 * self._digits, False)),
            "high": Const(0, signed(len(a) + 2)),
        }
        state = self.iteration.built(m, self.start, self.done, loaded, self._advanced)
        m.d.comb += self.product.eq(Cat(state["low"][1:], state["high"]).as_signed())
        return m

    def _advanced(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        a, low, high = state["multiplicand"], state["low"], state["high"]
        for place in range(self._rows):
            digit = low[:3]
            multiple = booth_row(a, digit)
            total = named(m, f"total_{place}", high + multiple + digit[2])
            high = fitted(total >> 2, len(high), True)
            low = Cat(low[2:], total[:2])
        return {"multiplicand": a, "low": low, "high": high}
