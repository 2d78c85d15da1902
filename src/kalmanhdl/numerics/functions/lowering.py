"""Functions of a graph of reals as operations on integers."""

from fractions import Fraction
from typing import assert_never

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.operations import Function
from kalmanhdl.numerics.functions.circuit import Circuit
from kalmanhdl.numerics.functions.cordic import arctangent_of, hypotenuse_of, rotated
from kalmanhdl.numerics.functions.exponential import exponential
from kalmanhdl.numerics.functions.interpolation import SINE, interpolated
from kalmanhdl.numerics.functions.method import Cordic, FunctionMethod
from kalmanhdl.numerics.functions.square_root import square_root

# How far values reach whatever their arguments are.
REACH = {Function.SINE: 1.0, Function.COSINE: 1.0, Function.ARCTANGENT: 0.5, Function.WRAP: 0.5}

# Bits below the last one of the result, so that a later rounding is nearly the only one.
GUARD = 2
# Bits of an angle below those of its sine: a turn is more than six radians.
_ANGLE_BITS = 4


def lowered(
    circuit: Circuit, function: Function, operands: tuple[int, ...], form: Fixed, method: FunctionMethod
) -> int:
    """A function of integers, within 0.3 of the last bit of ``form``, into which the result is rounded later.

    A square root is exact to the bit below the last one, rounded down; ``wrap`` is exact.
    """
    fraction = form.fraction + GUARD
    match function:
        case Function.SINE | Function.COSINE:
            return _sine(circuit, operands[0], max(fraction, 1), function is Function.COSINE, method)
        case Function.SQUARE_ROOT:
            return square_root(circuit, operands[0], form.fraction + 1)
        case Function.EXPONENTIAL:
            top = form.width - form.fraction - form.signed
            return exponential(circuit, operands[0], fraction, top, method)
        case Function.WRAP:
            bits = max(circuit.fraction(operands[0]), 1)
            return circuit.bits(operands[0], Fixed(width=bits, fraction=bits))
        case Function.ARCTANGENT:
            fraction = max(fraction, 1)
            y, x = operands
            return arctangent_of(circuit, y, x, fraction, max(form.width + GUARD, fraction))
        case Function.HYPOTENUSE if isinstance(method, Cordic):
            y, x = operands
            return hypotenuse_of(circuit, y, x, fraction, form.width + GUARD)
        case Function.HYPOTENUSE:
            a, b = (circuit.builder.multiply(each, each) for each in operands)
            return square_root(circuit, circuit.add(a, b), form.fraction + 1)
        case _:
            assert_never(function)


def _sine(circuit: Circuit, a: int, fraction: int, is_cosine: bool, method: FunctionMethod) -> int:
    bits = fraction + _ANGLE_BITS
    turn = Fixed(width=bits, fraction=bits)
    if isinstance(method, Cordic):
        return rotated(circuit, circuit.bits(a, turn), fraction)[not is_cosine]
    quarter = circuit.constant(Fraction(1, 4))
    angle = circuit.bits(a, turn)
    if is_cosine:
        angle = circuit.bits(circuit.add(angle, quarter), turn)
    # Half a turn further the sine is the opposite, and it is odd: a quarter of a turn is enough.
    near = circuit.bits(angle, Fixed(width=bits - 1, fraction=bits))
    sine = interpolated(circuit, circuit.shift(circuit.magnitude(near), 2), SINE, method.index_bits, fraction)
    opposite = circuit.subtract(circuit.constant(0), sine)
    signed = circuit.where_negative(near, opposite, sine)
    reverse = circuit.where_negative(near, sine, opposite)
    return circuit.where_negative(circuit.bits(circuit.add(angle, quarter), turn), reverse, signed)
