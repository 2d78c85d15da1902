"""Widths of Amaranth values, changed without changing the number."""

from amaranth.hdl import Cat, Const, Shape, Value, signed, unsigned

from kalmanhdl.arithmetic.fixed import Fixed


def shape_of(form: Fixed) -> Shape:
    """The shape of the raw integers of a format."""
    return signed(form.width) if form.signed else unsigned(form.width)


def fitted(value: Value, width: int, is_signed: bool) -> Value:
    """The low ``width`` bits of an integer, sign or zero extended where it has fewer."""
    missing = width - len(value)
    if missing > 0:
        negative = value.shape().signed and len(value) > 0
        fill = value[-1].replicate(missing) if negative else Const(0, missing)
        value = Cat(value, fill)
    low = value[:width]
    return low.as_signed() if is_signed else low


def shifted_sum(x: Value, shift: int, y: Value, width: int, carry: Value | None = None) -> Value:
    """(x << shift) + y modulo 2**width as a signed integer, the bits of y below ``shift`` untouched.

    ``carry`` is one bit added at position ``shift``.
    """
    low = fitted(y, min(shift, width), False)
    count = width - len(low)
    if count == 0:
        return low.as_signed()
    high = fitted(x, count, False) + fitted(y >> shift, count, False)
    if carry is not None:
        high = high + carry
    return Cat(low, high[:count]).as_signed()
