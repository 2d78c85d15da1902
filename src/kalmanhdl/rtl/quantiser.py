"""The quantisation of a number in hardware: the definitions of ``arithmetic.fixed`` on Amaranth values."""

from amaranth.hdl import Const, Mux, Value

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, outside, rounded, saturated, wrapped
from kalmanhdl.rtl.shapes import fitted


def aligned(value: Value, fraction: int, form: Fixed, rounding: Rounding) -> Value:
    """A raw integer brought to the format's fraction and rounded, no bit of it lost above."""
    dropped = fraction - form.fraction
    if dropped <= 0:
        # Amaranth widens `<<` for every amount that its operand could hold; this knows the amount.
        return value.shift_left(-dropped)
    result = rounded(value, dropped, rounding)
    return fitted(result, max(len(value) - dropped + 1, 1), value.shape().signed)


def quantised(
    value: Value,
    fraction: int,
    form: Fixed,
    rounding: Rounding,
    overflow: Overflow,
    low: int | None = None,
    high: int | None = None,
) -> tuple[Value, Value]:
    """A raw integer brought into a format, and whether the rounded one lay outside of it.

    With ``low`` and ``high``, the interval of the raw integer at its own fraction, nothing is built
    for overflows that cannot happen. The value has the shape of the format.
    """
    at_fraction = aligned(value, fraction, form, rounding)
    if low is not None and high is not None and _fits(low, high, fraction, form, rounding):
        return fitted(at_fraction, form.width, form.signed), Const(0, 1)
    out = outside(at_fraction, form)
    if overflow is Overflow.SATURATE:
        return fitted(saturated(at_fraction, form, Mux), form.width, form.signed), out
    return fitted(wrapped(at_fraction, form), form.width, form.signed), out


def _fits(low: int, high: int, fraction: int, form: Fixed, rounding: Rounding) -> bool:
    """Whether every raw integer of an interval lies inside the format. Rounding is monotone."""
    return not any(outside(rounded(raw, fraction - form.fraction, rounding), form) for raw in (low, high))
