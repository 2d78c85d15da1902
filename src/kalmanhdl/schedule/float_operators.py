"""The hardware of the operations of a floating-point graph."""

from dataclasses import replace
from typing import assert_never

from kalmanhdl.arithmetic.float_structure import (
    Piece,
    addition,
    division,
    fused_addition,
    multiplication,
    one,
    rooting,
    row_number,
    scaling,
    weights,
    wrapping,
)
from kalmanhdl.arithmetic.product_structure import limb_widths
from kalmanhdl.graph.kinds import kind_of as kind_of_unit
from kalmanhdl.graph.kinds import limit
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Constant,
    Divide,
    Flag,
    Function,
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
)
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.operator import Operator, kind_of, picoseconds
from kalmanhdl.schedule.wanted import refused
from kalmanhdl.target.device import Device

# Significands of fewer bits cost less in logic than the way to a block.
_BITS_ALWAYS_IN_LOGIC = 4


def float_operator(typed: FloatGraph, index: int, device: Device, on_block: bool) -> Operator:
    """The operator of one operation. A fused product is no more than its two factors, side by side."""
    form, operation = typed.form, typed.graph.operations[index]
    pieces = float_pieces(typed, index, on_block)
    blocks = 0
    if on_block:
        limbs = limb_widths(form.mantissa + 1, False, False, device.multiplier_width)
        blocks = len(limbs) ** 2
    return Operator(
        kind=kind_of(operation),
        pieces=tuple(_picoseconds(piece, device) for piece in pieces) or (0,),
        weights=weights(pieces),
        blocks=blocks,
    )


def asked(typed: FloatGraph | TypedGraph, index: int, made: Operator) -> Operator:
    """The operator with the clocks that the design asks for. Raises ScheduleError for more than it holds."""
    if isinstance(typed, TypedGraph) or index in typed.fused:
        return made
    clocks = dict(typed.clocks)
    kind = kind_of_unit(typed.graph.operations[index], clocks)
    least = 0 if kind is None else limit(kind, clocks) or 0
    if least - 1 > made.capacity:
        raise refused(
            f"clocks.{kind}", f" is {least}: in {typed.form} it takes {made.capacity + 1} clocks at most"
        )
    # The next operation takes the result in the clock after the last register.
    return replace(made, asked=max(least - 1, 0))


def float_pieces(typed: FloatGraph, index: int, on_block: bool) -> tuple[Piece, ...]:
    """The pieces of logic of an operation's operator, ``on_block`` if it multiplies on multiplier blocks."""
    form, operation = typed.form, typed.graph.operations[index]
    match operation:
        case Flag() | State() | StateFlag() | Constant() | Not():
            return ()
        case Input():
            return (one(("compare", form.exponent), ("select", form.width)),)
        case Add() | Subtract():
            return addition(form) if typed.fused_sum(index) is None else fused_addition(form, on_block)
        case Multiply():
            return () if index in typed.fused else multiplication(form, on_block)
        case Shift(exponent=exponent):
            return scaling(form, exponent)
        case Divide() | Reciprocal():
            return division(form)
        case Unary(function=function):
            return wrapping(form) if function is Function.WRAP else rooting(form)
        case Table(rows=rows):
            return row_number(form, len(rows))
        case Select():
            return (one(("select", form.width if typed.formats[index] else 1)),)
        case NotFinite():
            return (one(("compare", form.exponent)),)
        case Negative():
            return (one(("compare", form.width)),)
        case And() | Or():
            return (one(("select", 1)),)
        case Quantise() | Bits() | Outside() | SumOfProducts() | SumOutside() | Binary():
            raise AssertionError(f"{operation} in the hardware of floating-point numbers")
        case _:
            assert_never(operation)


def _picoseconds(piece: Piece, device: Device) -> int:
    return picoseconds(max(sum(device.delay_ns(*part) for part in path) for path in piece.paths))


def is_float_multiplier(typed: FloatGraph, index: int) -> bool:
    """Whether an operation multiplies significands that blocks are worth."""
    operation = typed.graph.operations[index]
    wide = typed.form.mantissa + 1 > _BITS_ALWAYS_IN_LOGIC
    if isinstance(operation, Multiply):
        return wide and index not in typed.fused
    return wide and typed.fused_sum(index) is not None
