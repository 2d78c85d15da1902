"""Where the leading one of a number stands, and shifts by a variable amount."""

from amaranth.hdl import Cat, Const, Module, Mux, Value

from kalmanhdl.rtl.stages import named


def leading_zeros(bits: Value) -> Value:
    """How many zeros stand above the highest one of some bits; their number if there is none."""
    count = len(bits)
    places = max(count.bit_length(), 1)
    padded = Cat(Const(1, 1).replicate((1 << places) - count), bits)
    return _counted(padded)[1]


def _counted(bits: Value) -> tuple[Value, Value]:
    """Whether there is a one, and the zeros above it in binary. A power of two of bits."""
    if len(bits) == 1:
        return bits[0], Const(0, 0)
    half = len(bits) // 2
    (low_any, low), (high_any, high) = _counted(bits[:half]), _counted(bits[half:])
    return low_any | high_any, Cat(Mux(high_any, high, low)[: len(low)], ~high_any)


def shifted_left(m: Module, name: str, value: Value, amount: Value, most: int) -> Value:
    """An unsigned value shifted left by 0 to ``most`` bits, no bit lost."""
    width = len(value) + most
    for place in reversed(range(len(amount))):
        moved = value.shift_left(1 << place)
        value = named(m, f"{name}_{place}", Mux(amount[place], moved, value)[:width])
    return value
