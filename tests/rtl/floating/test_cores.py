"""Floating-point cores give what the definition says, and what NumPy says, at any depth."""

from itertools import product

import numpy as np
import pytest

import float_vectors
from core_runs import CompiledCores
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.errors import FormatError
from kalmanhdl.rtl.floating.adder import FloatAdder
from kalmanhdl.rtl.floating.comparer import FloatComparer
from kalmanhdl.rtl.floating.converters import FixedToFloat, FloatToFixed
from kalmanhdl.rtl.floating.divider import FloatDivider
from kalmanhdl.rtl.floating.fused import FloatFused
from kalmanhdl.rtl.floating.multiplier import FloatMultiplier
from kalmanhdl.rtl.floating.scaler import FloatScaler
from kalmanhdl.rtl.floating.square_root import FloatSquareRoot
from kalmanhdl.rtl.floating.table import FloatTable
from kalmanhdl.rtl.floating.wrapper import FloatWrapper

TOWARD_ZERO = Rounding.TOWARD_ZERO
TINY = (
    Float(3, 2),
    Float(2, 4, TOWARD_ZERO),
    Float(3, 3, subnormals=False),
    Float(4, 1, TOWARD_ZERO, subnormals=False),
    Float(2, 2),
)
NUMPY = {Float(8, 23): (np.float32, np.uint32), Float(5, 10): (np.float16, np.uint16)}


def arithmetic(form, registers):
    """The operations that NumPy has."""
    return {
        "add": FloatAdder(form, registers),
        "subtract": FloatAdder(form, registers + 1, difference=True),
        "multiply": FloatMultiplier(form, registers + 2),
        "divide": FloatDivider(form, registers + 3),
        "square_root": FloatSquareRoot(form, registers + 4),
    }


def cores(form, registers, on_block=True):
    """One of each, with so many registers in each, and one more in every next."""
    depth = iter(range(registers, registers + 100))
    rows = tuple(form.nearest(row) for row in (1.0, -2.0, 0.5, 3.0, 1.5))
    return {
        "add": FloatAdder(form, next(depth)),
        "subtract": FloatAdder(form, next(depth), difference=True),
        "multiply": FloatMultiplier(form, next(depth), on_block),
        "divide": FloatDivider(form, next(depth)),
        "square_root": FloatSquareRoot(form, next(depth)),
        "up": FloatScaler(form, 2, next(depth)),
        "down": FloatScaler(form, -3, next(depth)),
        "wrap": FloatWrapper(form, next(depth)),
        "table": FloatTable(form, rows, next(depth)),
        "fused": FloatFused(form, next(depth), on_block),
        "fused_minus_product": FloatFused(form, next(depth), not on_block, minus_product=True),
        "fused_minus_addend": FloatFused(form, next(depth), not on_block, minus_addend=True),
    }


@pytest.mark.parametrize(
    "form", [Float(3, 2), Float(3, 3, TOWARD_ZERO), Float(4, 3, subnormals=False)], ids=str
)
def test_every_number_of_tiny_formats_is_converted_and_compared(form):
    built = {"compare": FloatComparer(form, 1)}
    for fraction, signed in product((-1, 0, 2, 5), (True, False)):
        fixed = Fixed(width=form.width, fraction=fraction, signed=signed)
        registers = fraction + 1
        built[f"to_fixed {fraction} {signed}"] = FloatToFixed(form, fixed, registers)
        built[f"from_fixed {fraction} {signed}"] = FixedToFloat(fixed, form, registers)
    built = {name.replace(" ", "_").replace("-", "m"): core for name, core in built.items()}
    numbers = np.arange(1 << form.width)
    check(built, [each.ravel() for each in np.meshgrid(numbers, numbers)])


def test_a_fixed_format_of_subnormals_alone_is_refused():
    with pytest.raises(FormatError, match="ends below the least normal number"):
        FloatToFixed(Float(3, 2), Fixed(width=4, fraction=9))


def check(built, operands):
    """Every core against its own ``compute``."""
    found = CompiledCores(built).results(*operands)
    triples = list(zip(*(map(int, array) for array in operands), strict=True))
    for name, core in built.items():
        given = [k for k, port in enumerate("abc") if hasattr(core, port)]
        for triple, value in zip(triples, found[name].tolist(), strict=True):
            taken = [triple[k] for k in given]
            assert value == core.compute(*taken), (name, core.form, core.registers, list(map(hex, taken)))


@pytest.mark.slow
@pytest.mark.parametrize("form", TINY, ids=str)
def test_every_operand_of_a_tiny_format(form):
    count = 1 << form.width
    a, b = (each.ravel() for each in np.meshgrid(np.arange(count), np.arange(count)))
    c = np.random.default_rng(form.width).integers(0, count, len(a))
    check(cores(form, 0), (a, b, c))


def test_operands_of_the_tiniest_formats():
    form = Float(2, 1)
    numbers = np.arange(1 << form.width)
    check(cores(form, 1, on_block=False), [each.ravel() for each in np.meshgrid(numbers, numbers, numbers)])


def test_reciprocals():
    form = Float(4, 3)
    core = FloatDivider(form, 2, reciprocal=True)
    b = np.arange(1 << form.width)
    # The only operand is the port b.
    found = CompiledCores({"reciprocal": core}).results(b)["reciprocal"]
    one = form.nearest(1.0)
    assert found.tolist() == [core.compute(one, int(raw)) for raw in b]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_formats_of_any_size(seed):
    random = np.random.default_rng(seed)
    form = Float(
        int(random.integers(2, 12)),
        int(random.integers(1, 50)),
        TOWARD_ZERO if random.random() < 0.4 else Rounding.HALF_EVEN,
        bool(random.random() < 0.6),
    )
    check(cores(form, int(random.integers(0, 30))), float_vectors.operands(form, 3000, seed, 3))


@pytest.mark.parametrize("form", NUMPY, ids=str)
def test_numpy_agrees(form):
    number, integer = NUMPY[form]
    a, b = float_vectors.operands(form, 20_000, seed=form.width)
    found = CompiledCores(arithmetic(form, 5)).results(a, b)
    x, y = (each.astype(integer).view(number) for each in (a, b))
    with np.errstate(all="ignore"):
        expected = {name: getattr(np, name)(x, y) for name in ("add", "subtract", "multiply", "divide")}
        expected["square_root"] = np.sqrt(x)
    for name, values in expected.items():
        raws = np.where(np.isnan(values), form.nan, values.view(integer))
        unequal = np.flatnonzero(found[name] != raws)
        assert not len(unequal), (name, hex(a[unequal[0]]), hex(b[unequal[0]]))
