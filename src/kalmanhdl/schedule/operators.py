"""The operator library: how long an operation takes on a device, and where registers can cut it.

Delays are whole picoseconds, so that sums compare exactly and schedules do not depend on the order of
additions.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import assert_never

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.division_structure import ONE, Operand, long_structure
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, outside, rounded
from kalmanhdl.arithmetic.pipelining import register_places
from kalmanhdl.graph.operations import (
    Add,
    And,
    Constant,
    Divide,
    Flag,
    Input,
    Multiply,
    Not,
    Or,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    StateFlag,
    Subtract,
)
from kalmanhdl.numerics.typed import Interval, TypedGraph
from kalmanhdl.target.device import Device

# A multiplication of so few rows costs less in logic than the way to a block.
_ROWS_ALWAYS_IN_LOGIC = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Operator:
    """The hardware of one operation: indivisible ``pieces`` of logic in order, in picoseconds.

    A pipeline register can stand between any two pieces. ``blocks`` counts multiplier blocks.
    """

    kind: str
    pieces: tuple[int, ...]
    blocks: int = 0

    @property
    def delay(self) -> int:
        """Picoseconds from operands to value without registers inside."""
        return sum(self.pieces)

    @property
    def capacity(self) -> int:
        """The number of registers that it can hold."""
        return len(self.pieces) - 1

    def stages(self, registers: int) -> tuple[int, ...]:
        """The delays of its stages when it holds so many registers."""
        return stages(self.pieces, registers)


def picoseconds(nanoseconds: float) -> int:
    """Whole picoseconds."""
    return round(1000 * nanoseconds)


@lru_cache(maxsize=4096)
def stages(pieces: tuple[int, ...], registers: int) -> tuple[int, ...]:
    """The delays of the stages between the registers, which stand where the hardware puts them."""
    loads = [0]
    for count, piece in zip(register_places(pieces, registers), (*pieces, 0), strict=True):
        loads += [0] * count
        loads[-1] += piece
    return tuple(loads)


def operators(typed: TypedGraph, device: Device, on_block: frozenset[int]) -> tuple[Operator, ...]:
    """The operator of every operation; those in ``on_block`` multiply on multiplier blocks."""
    return tuple(
        operator(typed, index, device, index in on_block) for index in range(len(typed.graph.operations))
    )


def operator(typed: TypedGraph, index: int, device: Device, on_block: bool) -> Operator:
    """The operator of one operation, on multiplier blocks or built from logic."""
    operation = typed.graph.operations[index]
    match operation:
        case Input() | Flag() | State() | StateFlag() | Constant():
            return Operator(kind=_kind(operation), pieces=(0,))
        case Shift() | Not():
            return Operator(kind=_kind(operation), pieces=(0,))
        case Add(a, b) | Subtract(a, b):
            return _wired(operation, _adder(typed, index, a, b, device))
        case Multiply(a, b):
            pieces, blocks = _multiplier(typed, a, b, device, on_block)
            return Operator(kind="multiply", pieces=pieces, blocks=blocks)
        case Select(_, a, _):
            form = typed.formats[index]
            return _wired(operation, _delay(device, "select", form.width if form else 1))
        case Quantise(a, form, rounding, overflow):
            return _wired(operation, _quantiser(typed, a, form, rounding, overflow, device))
        case Outside(a, form, rounding):
            return _wired(operation, _limit_check(typed, a, form, rounding, device))
        case And() | Or():
            return _wired(operation, _delay(device, "select", 1))
        case Divide(a, b):
            pieces = _long_division(typed, index, _operand(typed, a), b, device)
            return Operator(kind="divide", pieces=pieces)
        case Reciprocal(a):
            return _reciprocal(typed, index, a, device, on_block)
        case _:
            assert_never(operation)


def is_multiplier(typed: TypedGraph, index: int) -> bool:
    """Whether an operation gains from multiplier blocks."""
    operation = typed.graph.operations[index]
    if isinstance(operation, Reciprocal):
        return isinstance(typed.division, TableNewton) and typed.division.iterations > 0
    if not isinstance(operation, Multiply):
        return False
    return min(rows(typed, operation.a), rows(typed, operation.b)) > _ROWS_ALWAYS_IN_LOGIC


def rows(typed: TypedGraph, index: int) -> int:
    """Partial products when this operand multiplies in logic: its bits, or a constant's signed digits."""
    form = _number(typed, index)
    interval = typed.intervals[index]
    if isinstance(typed.graph.operations[index], Constant) and interval is not None:
        return signed_digits(interval.low)
    return form.width


def signed_digits(value: int) -> int:
    """The number of digits other than zero in the canonical signed-digit form."""
    magnitude = abs(value)
    return ((3 * magnitude) ^ magnitude).bit_count()


def limbs(form: Fixed, device: Device) -> int:
    """Into how many limbs an operand is cut to fit multiplier blocks; all but the top are unsigned."""
    width = form.width + (not form.signed)
    return 1 + max(0, -((device.multiplier_width - width) // (device.multiplier_width - 1)))


def is_free_quantise(interval: Interval, fraction: int, form: Fixed, rounding: Rounding) -> bool:
    """Whether a quantisation only drops bits: a floor, or nothing dropped, and every value fits."""
    drops = fraction - form.fraction
    return (drops <= 0 or rounding is Rounding.FLOOR) and not _leaves(interval, drops, form, rounding)


def _kind(operation: object) -> str:
    name = type(operation).__name__
    return "state_flag" if name == "StateFlag" else name.lower()


def _wired(operation: object, delay: int) -> Operator:
    return Operator(kind=_kind(operation), pieces=(delay,))


def _delay(device: Device, kind: str, size: int) -> int:
    return picoseconds(device.delay_ns(kind, size))


def _number(typed: TypedGraph, index: int) -> Fixed:
    form = typed.formats[index]
    assert form is not None
    return form


def _adder(typed: TypedGraph, index: int, a: int, b: int, device: Device) -> int:
    form = _number(typed, index)
    # Where one operand has no bits the sum's are the other's, without a carry; a borrow needs them.
    passed = abs(_number(typed, a).fraction - _number(typed, b).fraction)
    if isinstance(typed.graph.operations[index], Subtract):
        passed = max(0, _number(typed, a).fraction - _number(typed, b).fraction)
    return _delay(device, "add", max(1, form.width - passed))


def _multiplier(
    typed: TypedGraph, a: int, b: int, device: Device, on_block: bool
) -> tuple[tuple[int, ...], int]:
    form_a, form_b = _number(typed, a), _number(typed, b)
    if on_block:
        return _block_product(form_a, form_b, device)
    few, wide = sorted((rows(typed, a), rows(typed, b)))
    return _logic_product(few, max(wide, form_a.width, form_b.width), device), 0


def _block_product(a: Fixed, b: Fixed, device: Device) -> tuple[tuple[int, ...], int]:
    blocks = limbs(a, device) * limbs(b, device)
    adder = _delay(device, "add", a.width + b.width)
    depth = (blocks - 1).bit_length()
    return (_delay(device, "multiply", device.multiplier_width), *[adder] * depth), blocks


def _logic_product(count: int, width: int, device: Device) -> tuple[int, ...]:
    """Partial products in a tree of adders, wider at each level."""
    depth = (max(count, 1) - 1).bit_length()
    return tuple(_delay(device, "add", width + (1 << level)) for level in range(1, depth + 1)) or (0,)


def _leaves(interval: Interval, drops: int, form: Fixed, rounding: Rounding) -> bool:
    ends = (rounded(end, drops, rounding) for end in (interval.low, interval.high))
    return any(outside(end, form) for end in ends)


def _rounding_delay(drops: int, rounding: Rounding, width: int, device: Device) -> int:
    if drops <= 0 or rounding is Rounding.FLOOR:
        return 0
    return _delay(device, "add", width)


def _limits(typed: TypedGraph, a: int, form: Fixed, rounding: Rounding) -> tuple[int, bool, int]:
    source, interval = _number(typed, a), typed.intervals[a]
    drops = source.fraction - form.fraction
    assert interval is not None
    top_bits = max(1, source.width - drops - form.width + 1)
    return drops, _leaves(interval, drops, form, rounding), top_bits


def _quantiser(
    typed: TypedGraph, a: int, form: Fixed, rounding: Rounding, overflow: Overflow, device: Device
) -> int:
    drops, leaves, top_bits = _limits(typed, a, form, rounding)
    delay = _rounding_delay(drops, rounding, form.width, device)
    if leaves and overflow is Overflow.SATURATE:
        delay += _delay(device, "compare", top_bits) + _delay(device, "select", form.width)
    return delay


def _limit_check(typed: TypedGraph, a: int, form: Fixed, rounding: Rounding, device: Device) -> int:
    drops, leaves, top_bits = _limits(typed, a, form, rounding)
    if not leaves:
        return 0
    return _rounding_delay(drops, rounding, form.width, device) + _delay(device, "compare", top_bits)


def _operand(typed: TypedGraph, index: int) -> Operand:
    interval = typed.intervals[index]
    assert interval is not None
    return Operand(form=_number(typed, index), low=interval.low, high=interval.high)


def _long_division(
    typed: TypedGraph, index: int, dividend: Operand, divisor: int, device: Device
) -> tuple[int, ...]:
    radix = typed.division.radix if isinstance(typed.division, LongDivision) else 2
    form, rounding = _number(typed, index), typed.division_rounding
    structure = long_structure(dividend, _operand(typed, divisor), form, rounding, radix)
    row = _delay(device, "add", structure.row_width)
    wide_row = row + _delay(device, "select", structure.row_width)
    pieces = [row if bits == 1 else wide_row for bits in structure.row_bits]
    if structure.biased:
        pieces.insert(0, _delay(device, "add", structure.row_width))
    if structure.ties:
        pieces.append(_delay(device, "compare", structure.row_width))
    if structure.above or structure.below:
        pieces.append(_delay(device, "select", form.width))
    return tuple(pieces)


def _finish(form: Fixed, device: Device) -> int:
    return _delay(device, "add", form.width) + _delay(device, "select", form.width)


def _reciprocal(typed: TypedGraph, index: int, a: int, device: Device, on_block: bool) -> Operator:
    if isinstance(typed.division, LongDivision):
        return Operator(kind="reciprocal", pieces=_long_division(typed, index, ONE, a, device))
    form, divisor = _number(typed, index), _number(typed, a)
    pieces = [
        _delay(device, "leading_one", divisor.width),
        _delay(device, "shift", divisor.width),
        _delay(device, "table", typed.division.index_bits),
    ]
    blocks = 0
    fractions = typed.division.fractions(form)
    for fraction, target in pairwise(fractions):
        value, factor = fraction + 1, target + 3
        for x, y in ((divisor.width, value), (value, factor)):
            product, used = _product(x, y, device, on_block)
            pieces += product
            blocks += used
        # The factor is 2 minus a product: one subtraction between the two multiplications.
        pieces.insert(len(pieces) - len(product), _delay(device, "add", factor))
    pieces += [_delay(device, "shift", fractions[-1] + 1), _finish(form, device)]
    return Operator(kind="reciprocal", pieces=tuple(pieces), blocks=blocks)


def _product(x: int, y: int, device: Device, on_block: bool) -> tuple[tuple[int, ...], int]:
    if on_block:
        wide, narrow = (Fixed(width=width, fraction=0, signed=False) for width in (x, y))
        return _block_product(wide, narrow, device)
    return _logic_product(min(x, y), max(x, y), device), 0
