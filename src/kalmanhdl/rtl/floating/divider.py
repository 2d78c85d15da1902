"""Floating-point division: non-restoring rows, one quotient bit a piece."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.float_structure import division, exponent_width, levels
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import Parts, decoded, rounded
from kalmanhdl.rtl.floating.shifting import denormalised, normalised
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class FloatDivider(wiring.Component):
    """a / b: ``arithmetic.floating.divide``, ``registers`` clocks after its operands.

    As a ``reciprocal`` it has no port ``a`` and gives 1 / b.
    """

    def __init__(self, form: Float, registers: int = 0, reciprocal: bool = False) -> None:
        self.form, self.registers, self.reciprocal = form, registers, reciprocal
        self._width = exponent_width(form, form.mantissa)
        dividend = {} if reciprocal else {"a": In(form.width)}
        super().__init__(dividend | {"b": In(form.width), "result": Out(form.width)})

    def compute(self, a: int, b: int) -> int:
        """The quotient of encoded numbers."""
        return floating.divide(self.form, a, b)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        form = self.form
        chain = Chain(m, division(form), self.registers)
        one = Const(form.nearest(1.0), form.width)
        a = decoded(m, "a", form, one if self.reciprocal else self.a)
        state = _started(a, decoded(m, "b", form, self.b))
        if form.subnormals:
            names = ("b",) if self.reciprocal else ("a", "b")
            state = normalised(chain, state, levels(form.mantissa), names)
        state = self._rows(m, chain, self._placed(m, state))
        state = chain.after_piece(_with_remainder(m, state))
        state = chain.after_piece(_with_leading_one(m, state))
        m.d.comb += self.result.eq(rounded(chain, form, denormalised(chain, form, state)))
        chain.finish()
        return m

    def _placed(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """The exponent less one of a quotient from 1 on."""
        exponents = {}
        for name in ("a", "b"):
            exponent = fitted(state.pop(f"{name}_exponent"), self._width, True)
            exponents[name] = exponent - state.pop(f"{name}_shift", Const(0, 1))
        below = exponents["a"] - exponents["b"] + (self.form.bias - 1)
        return state | {"below": named(m, "below", below[: self._width])}

    def _rows(self, m: Module, chain: Chain, state: dict[str, Value]) -> dict[str, Value]:
        """As many bits as the significand, a guard bit, and one more for a quotient below 1."""
        width = self.form.mantissa + 2
        dividend, divisor = (fitted(state[key], width, False) for key in ("a", "b"))
        partial = named(m, "partial_0", (dividend - divisor)[:width])
        del state["a"]
        state |= {"partial": partial, "bits": ~partial[-1]}
        for row in range(1, width + 1):
            state = chain.after_piece(state)
            partial = named(m, f"partial_{row}", _next_partial(state["partial"], state["b"]))
            state |= {"partial": partial, "bits": Cat(~partial[-1], state["bits"])}
        return chain.after_piece(state)


def _started(a: Parts, b: Parts) -> dict[str, Value]:
    return {
        "a": a.significand,
        "b": b.significand,
        "a_exponent": a.exponent,
        "b_exponent": b.exponent,
        "sign": a.sign ^ b.sign,
        "zero": a.zero | b.infinite,
        "infinite": a.infinite | b.zero,
        "nan": a.nan | b.nan | (a.infinite & b.infinite) | (a.zero & b.zero),
    }


def _next_partial(partial: Value, divisor: Value) -> Value:
    """Twice the partial remainder less the divisor, or plus it where it is negative."""
    width = len(partial)
    less = ~partial[-1]
    addend = fitted(divisor, width, False) ^ less.replicate(width)
    # The one that a complement lacks comes in by a bit below the last.
    return (Cat(less, Const(0, 1), partial[:-1]) + Cat(less, addend))[1 : 1 + width]


def _with_remainder(m: Module, state: dict[str, Value]) -> dict[str, Value]:
    """Whether anything is left: of a negative partial remainder, one divisor was taken too much."""
    partial, divisor = state.pop("partial"), state.pop("b")
    back = Mux(partial[-1], fitted(divisor, len(partial), False), 0)
    return state | {"sticky": named(m, "rest", (partial + back)[: len(partial)]).any()}


def _with_leading_one(m: Module, state: dict[str, Value]) -> dict[str, Value]:
    """The quotient from 1 on; one below 1, moved by a bit."""
    bits, below, sticky = state.pop("bits"), state.pop("below"), state.pop("sticky")
    whole = bits[-1]
    return state | {
        "significand": named(m, "significand", Mux(whole, bits[2:], bits[1:-1])),
        "guard": Mux(whole, bits[1], bits[0]),
        "sticky": sticky | (whole & bits[0]),
        "below": named(m, "quotient_below", (below - ~whole)[: len(below)]),
    }
