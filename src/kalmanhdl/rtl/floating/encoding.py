"""From the bits of a number to its parts, and from the parts of a result to its bits."""

from dataclasses import dataclass

from amaranth.hdl import Cat, Const, Module, Mux, Value

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.stages import named


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The parts of a number.

    ``significand`` has the hidden bit at its top; ``exponent`` is that of the significand: of a subnormal
    1, not 0. A subnormal that does not count is a zero.
    """

    sign: Value
    exponent: Value
    significand: Value
    normal: Value
    zero: Value
    infinite: Value
    nan: Value


def decoded(m: Module, name: str, form: Float, raw: Value) -> Parts:
    """The parts of an encoded number."""
    fraction, exponent = raw[: form.mantissa], raw[form.mantissa : -1]
    normal = named(m, f"{name}_normal", exponent.any())
    ended = named(m, f"{name}_ended", exponent.all())
    rest = named(m, f"{name}_rest", fraction.any())
    if not form.subnormals:
        fraction = fraction & normal.replicate(form.mantissa)
    return Parts(
        sign=raw[-1],
        exponent=Cat(exponent[0] | ~normal, exponent[1:]) if form.subnormals else exponent,
        significand=Cat(fraction, normal),
        normal=normal,
        zero=~normal & ~rest if form.subnormals else ~normal,
        infinite=ended & ~rest,
        nan=ended & rest,
    )


def canonical(m: Module, name: str, form: Float, raw: Value) -> Value:
    """An encoded number as it is kept: ``Float.canonical``."""
    parts = decoded(m, name, form, raw)
    magnitude = Mux(parts.nan, form.nan, raw[:-1])
    if not form.subnormals:
        magnitude = Mux(parts.zero, 0, magnitude)
    return Cat(magnitude[: form.width - 1], raw[-1] & ~parts.nan)


def rounded(chain: Chain, form: Float, state: dict[str, Value]) -> Value:
    """The encoded number of ``state``.

    ``significand`` has its leading one at the top, or may lack it where the exponent is 1. ``below`` is the
    biased exponent less one, signed. ``guard`` is the bit below the significand, ``sticky`` tells of ones
    below that. ``zero``, ``infinite`` and ``nan`` go before what the numbers say, the last before the first.
    """
    significand, below = state.pop("significand"), state.pop("below")
    guard, sticky = state.pop("guard"), state.pop("sticky")
    up: Value = Const(0, 1)
    if form.rounding is Rounding.HALF_EVEN:
        up = guard & (sticky | significand[0])
    # The leading one makes a biased exponent of the one below it, and of a subnormal's leaves zero.
    ones = Cat(up, Const(0, form.mantissa - 1), significand[-1])
    packed = Cat(significand[:-1], below)
    packed = named(chain.module, "packed", (packed + ones)[: len(packed)])
    state = chain.after_piece(state | {"packed": packed})
    state = chain.after_piece(_limited(form, state))
    return chain.after_piece({"result": _encoded(form, state)})["result"]


def _limited(form: Float, state: dict[str, Value]) -> dict[str, Value]:
    """What becomes of a number beyond the greatest, and of one below the least that counts."""
    packed, nan, infinite, zero = (state[key] for key in ("packed", "nan", "infinite", "zero"))
    exponent = packed[form.mantissa :]
    beyond = (exponent[form.exponent : -1].any() | exponent[: form.exponent].all()) & ~exponent[-1]
    if not form.subnormals:
        zero = zero | exponent[-1] | ~exponent[:-1].any()
    beyond = beyond & ~(nan | infinite | zero)
    greatest = beyond if form.rounding is Rounding.TOWARD_ZERO else Const(0, 1)
    return {
        "sign": state["sign"] & ~nan,
        "packed": packed[: form.width - 1],
        "kept": ~(nan | infinite | zero | beyond),
        "ended": nan | infinite | beyond,
        "greatest": greatest,
        "nan": nan,
    }


def _encoded(form: Float, state: dict[str, Value]) -> Value:
    kept, ended, greatest = (state[key] for key in ("kept", "ended", "greatest"))
    fraction = state["packed"][: form.mantissa] & kept.replicate(form.mantissa)
    fraction = fraction | greatest.replicate(form.mantissa)
    exponent = state["packed"][form.mantissa :] & kept.replicate(form.exponent)
    exponent = exponent | ended.replicate(form.exponent)
    quiet = fraction[form.mantissa - 1] | state["nan"]
    return Cat(fraction[:-1], quiet, exponent[0] & ~greatest, exponent[1:], state["sign"])


def chosen(flag: Value, a: Value, b: Value) -> Value:
    """a where the flag holds, else b, both of one width."""
    assert len(a) == len(b)
    return Mux(flag, a, b)[: len(a)]
