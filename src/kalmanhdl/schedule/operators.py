"""The operator library: the hardware of every operation of a graph, in integers or in floating point."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil, log
from typing import assert_never

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.division_structure import (
    ONE,
    Operand,
    TableStructure,
    in_one_table,
    long_structure,
    row_weights,
    table_structure,
)
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, outside, rounded, stands_below
from kalmanhdl.arithmetic.product_structure import (
    LogicProduct,
    booth_terms,
    limb_widths,
    recodes_first,
    tree_levels,
    wallace_levels,
    wallace_rows,
)
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Constant,
    Divide,
    Flag,
    Input,
    Multiply,
    Negative,
    Not,
    NotFinite,
    Or,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    StateFlag,
    Subtract,
    SumOfProducts,
    SumOutside,
    Table,
    Unary,
    operands,
)
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.signed_digits import FEW_DIGITS
from kalmanhdl.numerics.typed import Interval, TypedGraph
from kalmanhdl.schedule.accumulator import accumulator
from kalmanhdl.schedule.float_operators import asked, float_operator, is_float_multiplier
from kalmanhdl.schedule.operator import MultiplyAdd, Operator, kind_of, picoseconds
from kalmanhdl.schedule.sharing import NONE_SHARED, Core, Sharing, core
from kalmanhdl.target.device import Device

# Operands of so few turns are chosen among registers.
_FEW_TURNS = 8

# How the hardware weighs its steps, in levels of adders, when it places registers.
_BLOCK_WEIGHT = 2.0
_RECODING_WEIGHT = 0.5
_CARRY_SAVE_WEIGHT = 0.5


def operators(
    typed: TypedGraph | FloatGraph, device: Device, on_block: frozenset[int], shared: Sharing = NONE_SHARED
) -> tuple[Operator, ...]:
    """The operator of every operation; those in ``on_block`` multiply on multiplier blocks."""
    turns: dict[int, Operator] = {}
    for kind, who in shared.operations.items():
        made = _turned(typed, kind, shared, device, on_block)
        # The one row of an iterative operator cannot be cut.
        made = made if kind in shared.busy else _derated(made, device)
        turns |= {index: _taking(made, shared.pairs.get(index, 1)) for index in who}
    return tuple(
        turns[index]
        if index in turns
        else _derated(operator(typed, index, device, index in on_block), device)
        for index in range(len(typed.graph.operations))
    )


def _taking(made: Operator, pairs: int) -> Operator:
    """The operator for a sum of so many products: it adds for as many cycles."""
    return replace(made, pairs=pairs) if isinstance(made, MultiplyAdd) else made


def _derated(made: Operator, device: Device) -> Operator:
    factor = device.derate.get(made.kind, 1.0)
    return made if factor == 1 else replace(made, derate=factor)


def _turned(
    typed: TypedGraph | FloatGraph, kind: str, shared: Sharing, device: Device, on_block: frozenset[int]
) -> Operator:
    who, count = shared.operations[kind], shared.counts[kind]
    if kind in shared.busy:
        assert isinstance(typed, TypedGraph)
        return _iterative(typed, kind, shared, device)
    return shared_operator(typed, kind, who, device, count, on_block, shared.steps(kind))


def _iterative(typed: TypedGraph, kind: str, shared: Sharing, device: Device) -> Operator:
    """The operator of one row that works for one clock less than it is busy on what was loaded in one."""
    who, busy = shared.operations[kind], shared.busy[kind]
    count = shared.counts[kind]
    made = core(typed, kind, who)
    width = max(port.form.width for port in made.operands)
    if kind == "multiply":
        row = _delay(device, "select", width) + _delay(device, "add", width + 2)
        pieces: tuple[int, ...] = (0, *(row,) * (busy - 1), 0)
    else:
        before, *rows, after = division(typed, kind, made.operands, made.form, device, False).pieces
        pieces = (before, *(max(rows),) * (busy - 1), after)
    return Operator(
        kind=kind,
        pieces=pieces,
        fetch=_fetch(device, width, ceil(len(who) / count), shared.steps(kind)),
        # A register behind every piece but the last: one row works on them, clock after clock.
        asked=len(pieces) - 1 + shared.steps(kind),
    )


def shared_operator(
    typed: TypedGraph | FloatGraph,
    kind: str,
    who: tuple[int, ...],
    device: Device,
    count: int,
    on_block: frozenset[int],
    steps: int = 1,
) -> Operator:
    """The operator on which these operations take turns, one of ``count`` equal ones.

    Operands are chosen in so many ``steps``.
    """
    apart = core(typed, kind, who)
    width = max(port.form.width for port in apart.operands)
    if isinstance(typed, FloatGraph):
        inner = float_operator(typed, who[0], device, bool(on_block & frozenset(who)))
    else:
        inner = _integer_operator(typed, kind, who, device, count, on_block)
    fetch = _fetch(device, width, ceil(len(who) / count), steps)
    made = replace(inner, kind=kind, fetch=fetch, kept=apart.kept)
    return asked(typed, who[0], made)


def _integer_operator(
    typed: TypedGraph, kind: str, who: tuple[int, ...], device: Device, count: int, on_block: frozenset[int]
) -> Operator:
    made = core(typed, kind, who)
    forms = [port.form for port in made.operands]
    match kind:
        case "multiply":
            on_blocks = bool(on_block & frozenset(who))
            return _product(forms[0], forms[1], device, on_blocks, typed.logic_product)
        case "multiply_add":
            return _multiply_add(typed, made, who, device, count, bool(on_block & frozenset(who)))
        case "add" | "subtract":
            return Operator(kind=kind, pieces=(_delay(device, "add", made.form.width),))
        case _:
            return division(typed, kind, made.operands, made.form, device, bool(on_block & frozenset(who)))


def _multiply_add(
    typed: TypedGraph, made: Core, who: tuple[int, ...], device: Device, count: int, on_block: bool
) -> MultiplyAdd:
    """A product, its place in the sum, the sum, its quantisation, the choice among ``count`` of these."""
    product = _product(made.operands[0].form, made.operands[1].form, device, on_block, typed.logic_product)
    sums, width = accumulator(typed, who), made.form.width
    place = _delay(device, "shift", sums.lifts + 1) if sums.lifts else 0
    rounding = _delay(device, "add", width) if sums.rounds else 0
    limits = _delay(device, "compare", sums.width - sums.dropped) + _delay(device, "select", width)
    return MultiplyAdd(
        kind="multiply_add",
        pieces=product.pieces,
        weights=product.weights,
        blocks=product.blocks,
        add=place + _delay(device, "add", sums.width),
        ends=rounding + limits + _levels(len(sums.modes)) * _delay(device, "select", width),
        leaving=_levels(count) * _delay(device, "select", width),
    )


def _levels(choices: int) -> int:
    """Levels of logic that choose one of so many."""
    return ceil(log(choices, 4)) if choices > 1 else 0


def _fetch(device: Device, width: int, turns: int, steps: int) -> tuple[int, ...]:
    """To choose one of so many operands: few from registers, many from small memories."""
    select = _delay(device, "select", width)
    read, levels = 0, max(1, ceil(log(turns, 4)))
    if turns > _FEW_TURNS:
        read, levels = _delay(device, "context_read", 16), 2
    if steps == 1:
        return (read + levels * select,)
    later = levels // 2
    return (read + (levels - later) * select, later * select)


def operator(typed: TypedGraph | FloatGraph, index: int, device: Device, on_block: bool) -> Operator:
    """The operator of one operation, on multiplier blocks or built from logic."""
    if isinstance(typed, FloatGraph):
        return asked(typed, index, float_operator(typed, index, device, on_block))
    operation = typed.graph.operations[index]
    match operation:
        case Input() | Flag() | State() | StateFlag() | Constant():
            return Operator(kind=kind_of(operation), pieces=(0,))
        case Shift() | Bits() | Not() | Negative() | SumOutside():
            return Operator(kind=kind_of(operation), pieces=(0,))
        case Add(a, b) | Subtract(a, b):
            return _wired(operation, _adder(typed, index, a, b, device))
        case Multiply(a, b):
            return _product(_number(typed, a), _number(typed, b), device, on_block, typed.logic_product)
        case Select(_, a, _):
            form = typed.formats[index]
            return _wired(operation, _delay(device, "select", form.width if form else 1))
        case Table(_, rows):
            return _wired(operation, _delay(device, "table", (len(rows) - 1).bit_length()))
        case Quantise(a, form, rounding, overflow):
            return _wired(operation, _quantiser(typed, a, form, rounding, overflow, device))
        case Outside(a, form, rounding):
            return _wired(operation, _limit_check(typed, a, form, rounding, device))
        case And() | Or():
            return _wired(operation, _delay(device, "select", 1))
        case Divide() | Reciprocal():
            return _quotient(typed, index, device, on_block)
        case SumOfProducts(terms):
            alone = frozenset((index,) if on_block else ())
            one = shared_operator(typed, "multiply_add", (index,), device, 1, alone)
            return _taking(one, len(terms))
        case Unary() | Binary() | NotFinite():
            raise AssertionError(f"{operation} in a graph of integers")
        case _:
            assert_never(operation)


def is_multiplier(typed: TypedGraph | FloatGraph, index: int) -> bool:
    """Whether an operation gains from multiplier blocks."""
    if isinstance(typed, FloatGraph):
        return is_float_multiplier(typed, index)
    operation = typed.graph.operations[index]
    if isinstance(operation, Reciprocal):
        method = typed.division
        return (
            isinstance(method, TableNewton)
            and method.iterations > 0
            and not in_one_table(_operand(typed, operation.a), method)
        )
    if isinstance(operation, SumOfProducts):
        return True
    if not isinstance(operation, Multiply):
        return False
    return min(rows(typed, operation.a), rows(typed, operation.b)) > FEW_DIGITS


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


def _wired(operation: object, delay: int) -> Operator:
    return Operator(kind=kind_of(operation), pieces=(delay,))


def _delay(device: Device, kind: str, size: int) -> int:
    return picoseconds(device.delay_ns(kind, size))


def _number(typed: TypedGraph, index: int) -> Fixed:
    form = typed.formats[index]
    assert form is not None
    return form


def _adder(typed: TypedGraph, index: int, a: int, b: int, device: Device) -> int:
    form, is_sum = _number(typed, index), isinstance(typed.graph.operations[index], Add)
    x, y = _number(typed, a), _number(typed, b)
    if is_sum and (stands_below(x, y) or stands_below(y, x)):
        return 0
    # Where one operand has no bits the sum's are the other's, without a carry; a borrow needs them.
    passed = abs(x.fraction - y.fraction) if is_sum else max(0, x.fraction - y.fraction)
    return _delay(device, "add", max(1, form.width - passed))


def _product(
    a: Fixed, b: Fixed, device: Device, on_block: bool, logic: LogicProduct = LogicProduct.BOOTH
) -> Operator:
    """One block for each pair of limbs, or the rows of a multiplication from logic; then a tree of adders."""
    if not on_block and logic is LogicProduct.WALLACE:
        return _wallace(a, b, device)
    if on_block:
        limbs_a = limb_widths(a.width, a.signed, b.signed, device.multiplier_width)
        limbs_b = limb_widths(b.width, b.signed, a.signed, device.multiplier_width)
        terms = blocks = len(limbs_a) * len(limbs_b)
        first, weight = _delay(device, "multiply", device.multiplier_width), _BLOCK_WEIGHT
    else:
        recoded = a if recodes_first(a.width, a.signed, b.width, b.signed) else b
        terms, blocks = booth_terms(recoded.width, recoded.signed), 0
        first, weight = _delay(device, "select", a.width + b.width - recoded.width), _RECODING_WEIGHT
    levels = tree_levels(terms)
    adder = _delay(device, "add", a.width + b.width)
    return Operator(
        kind="multiply",
        pieces=(first, *(adder,) * levels),
        weights=(weight, *(1.0,) * levels),
        blocks=blocks,
    )


def _wallace(a: Fixed, b: Fixed, device: Device) -> Operator:
    """The products of single bits, levels of carry-save adders, one adder."""
    saves = wallace_levels(wallace_rows(a.width, a.signed, b.width, b.signed))
    bits, adder = _delay(device, "select", 1), _delay(device, "add", a.width + b.width)
    return Operator(
        kind="multiply",
        pieces=(bits, *(bits,) * saves, adder),
        weights=(_RECODING_WEIGHT, *(_CARRY_SAVE_WEIGHT,) * saves, 1.0),
    )


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


def _quotient(typed: TypedGraph, index: int, device: Device, on_block: bool) -> Operator:
    operation = typed.graph.operations[index]
    assert isinstance(operation, Divide | Reciprocal)
    reads = [_operand(typed, k) for k in operands(operation)]
    return division(typed, kind_of(operation), reads, _number(typed, index), device, on_block)


def division(
    typed: TypedGraph, kind: str, reads: Sequence[Operand], form: Fixed, device: Device, on_block: bool
) -> Operator:
    """The operator that divides the first operand by the second, or gives the reciprocal of the only one."""
    method, rounding = typed.division, typed.division_rounding
    if len(reads) == 1 and isinstance(method, TableNewton):
        return _table_reciprocal(kind, reads[0], form, rounding, method, device, on_block)
    # A table gives reciprocals only; a quotient is always found by long division.
    radix = method.radix if isinstance(method, LongDivision) else 2
    dividend, divisor = reads if len(reads) == 2 else (ONE, reads[0])
    structure = long_structure(dividend, divisor, form, rounding, radix)
    row = _delay(device, "add", structure.row_width)
    wide_row = row + _delay(device, "select", structure.row_width)
    before = row if structure.biased else 0
    after = _delay(device, "compare", structure.row_width) if structure.ties else 0
    if structure.above or structure.below:
        after += _delay(device, "select", form.width)
    pieces = (before, *(row if bits == 1 else wide_row for bits in structure.row_bits), after)
    return Operator(kind=kind, pieces=pieces, weights=row_weights(structure))


def _table_reciprocal(
    kind: str,
    divisor: Operand,
    form: Fixed,
    rounding: Rounding,
    method: TableNewton,
    device: Device,
    on_block: bool,
) -> Operator:
    if in_one_table(divisor, method):
        return Operator(kind=kind, pieces=(_delay(device, "table", divisor.width),))
    structure = table_structure(divisor, form, rounding, method)
    places = max(1, structure.positions - 1)
    normalise = _delay(device, "leading_one", places) + _delay(device, "shift", structure.longest)
    pieces = [normalise, _delay(device, "table", method.index_bits)]
    blocks = 0
    for number, step in enumerate(structure.steps):
        for product in _newton_products(structure, number, device, on_block):
            pieces += product.pieces
            blocks += product.blocks
        # The value itself is one more addend of its new value.
        pieces.append(_delay(device, "add", step.target + 1))
    nearest = rounding not in (Rounding.FLOOR, Rounding.TOWARD_ZERO)
    back = _delay(device, "shift", form.width) + (_delay(device, "add", form.width) if nearest else 0)
    pieces += [back, _delay(device, "select", form.width) if structure.above else 0]
    return Operator(kind=kind, pieces=tuple(pieces), blocks=blocks)


def _newton_products(
    structure: TableStructure, number: int, device: Device, on_block: bool
) -> tuple[Operator, Operator]:
    """The divisor times the value (an entry of the table is negated), and the value times its change."""
    step = structure.steps[number]
    value = Fixed(width=step.fraction + 1, fraction=0, signed=False)
    by = value if number else Fixed(width=step.fraction + 2, fraction=0)
    divisor = Fixed(width=structure.longest, fraction=0, signed=False)
    change = Fixed(width=step.change_bits, fraction=0)
    return _product(divisor, by, device, on_block), _product(value, change, device, on_block)
