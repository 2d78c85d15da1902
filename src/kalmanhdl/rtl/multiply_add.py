"""A unit that sums products: multiplier, accumulator, one quantisation of the sum."""

from amaranth.hdl import Cat, Module, Mux, Shape, Signal, Value, signed
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.rtl.layouts import shape
from kalmanhdl.rtl.multiplier import Multiplier
from kalmanhdl.rtl.quantiser import quantised
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import delayed
from kalmanhdl.schedule.accumulator import Accumulator, Mode
from kalmanhdl.schedule.operator import MultiplyAddRegisters


class MultiplyAdd(Component):
    """Sums of ``a * b``, one product a clock.

    A product is added as many clocks after its operands as ``held`` has registers apart and inside: in
    that clock ``first`` says that it begins a sum, ``negative`` that it is taken away, ``place`` by how many
    bits it is shifted left. In the next clock ``mode`` says how the sum so far is quantised to the
    ``result``, one clock later where that is kept; ``outside`` is high where the rounded sum does not fit.
    Products are on a multiplier block, or ``logic``.
    """

    def __init__(
        self,
        a: Shape,
        b: Shape,
        sums: Accumulator,
        form: Fixed,
        held: MultiplyAddRegisters,
        logic: LogicProduct | None = None,
    ) -> None:
        self._sums, self._held, self._logic = sums, held, logic
        super().__init__(
            {
                "a": In(a),
                "b": In(b),
                "first": In(1),
                "negative": In(1),
                "place": In(range(sums.lifts + 1)),
                "mode": In(range(len(sums.modes))),
                "result": Out(shape(form)),
                "outside": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        on_block, logic = self._logic is None, self._logic or LogicProduct.BOOTH
        inner = Multiplier(self.a.shape(), self.b.shape(), self._held.inside, on_block, logic)
        m.submodules.multiplier = inner
        m.d.comb += [inner.a.eq(self.a), inner.b.eq(self.b)]
        product = delayed(m, inner.product, int(self._held.apart), "product")
        total = self._summed(m, product)
        self._quantise(m, total)
        return m

    def _summed(self, m: Module, product: Value) -> Signal:
        """The sum so far.

        What is taken away is complemented, and the one that this lacks comes as a carry from below the last
        bit: one adder does for both.
        """
        width = self._sums.width
        product = fitted(product, len(product) + (not product.shape().signed), False)
        placed = product ^ self.negative.replicate(len(product))
        for bit, chosen in enumerate(self.place):
            filled = Cat(self.negative.replicate(1 << bit), placed).as_signed()
            lifted = Signal(signed(min(width, len(filled))), name=f"lifted_{bit}")
            m.d.comb += lifted.eq(Mux(chosen, filled, placed.as_signed()))
            placed = lifted
        total = Signal(signed(width), reset_less=True)
        before = Mux(self.first, 0, total)[:width]
        both = Cat(self.negative, before) + Cat(self.negative, fitted(placed.as_signed(), width, False))
        m.d.sync += total.eq(both[1 : width + 1])
        return total

    def _quantise(self, m: Module, total: Signal) -> None:
        result, outside = Signal.like(self.result), Signal()
        with m.Switch(self.mode):
            for number, mode in enumerate(self._sums.modes):
                with m.Case(number):
                    value, out = _quantised(total, self._sums.dropped, mode)
                    m.d.comb += [result.eq(value), outside.eq(out)]
        kept = int(self._held.kept)
        m.d.comb += self.result.eq(delayed(m, result, kept, "result"))
        m.d.comb += self.outside.eq(delayed(m, outside, kept, "outside"))


def _quantised(total: Value, dropped: int, mode: Mode) -> tuple[Value, Value]:
    form = Fixed(width=mode.width, fraction=0, signed=mode.signed)
    return quantised(total, dropped, form, mode.rounding, mode.overflow)
