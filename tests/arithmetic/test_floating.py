"""Floating-point arithmetic against NumPy, against apytypes, and against itself on small formats."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.arithmetic.floating import (
    Float,
    add,
    divide,
    fused_multiply_add,
    multiply,
    square_root,
    subtract,
)
from kalmanhdl.errors import FormatError

BINARY = {"add": add, "subtract": subtract, "multiply": multiply, "divide": divide}
HALF, SINGLE = Float(5, 10), Float(8, 23)
TYPES = {HALF: (np.float16, np.uint16), SINGLE: (np.float32, np.uint32)}


def raws(form):
    """Raw integers: anywhere, and near the ends of the exponents and of the significands."""
    specials = [
        0,
        1,
        2,
        form.infinity,
        form.infinity - 1,
        form.nan,
        1 << form.mantissa,
        form.bias << form.mantissa,
    ]
    near = st.sampled_from(specials).flatmap(lambda raw: st.sampled_from([max(raw - 1, 0), raw, raw + 1]))
    magnitude = st.one_of(st.integers(0, form.infinity), near)
    return st.builds(lambda bits, sign: bits | sign, magnitude, st.sampled_from([0, form.sign]))


def same(form, found, expected):
    return found == expected or (form.is_nan(found) and form.is_nan(expected))


@pytest.mark.parametrize("form", [HALF, SINGLE])
@pytest.mark.parametrize("operation", BINARY)
@given(data=st.data())
def test_operations_equal_numpys(form, operation, data):
    number, integer = TYPES[form]
    a, b = data.draw(raws(form)), data.draw(raws(form))
    x, y = (np.array(raw, integer).view(number) for raw in (a, b))
    with np.errstate(all="ignore"):
        expected = getattr(np, operation)(x, y).view(integer)
    assert same(form, BINARY[operation](form, a, b), int(expected))


@pytest.mark.parametrize("form", [HALF, SINGLE])
@given(data=st.data())
def test_square_roots_equal_numpys(form, data):
    number, integer = TYPES[form]
    a = data.draw(raws(form))
    with np.errstate(all="ignore"):
        expected = np.sqrt(np.array(a, integer).view(number)).view(integer)
    assert same(form, square_root(form, a), int(expected))


FORMS = st.builds(
    Float,
    st.integers(3, 9),
    st.integers(2, 30),
    st.sampled_from([Rounding.HALF_EVEN, Rounding.TOWARD_ZERO]),
)


def _quantisation(form):
    import apytypes

    modes = {
        Rounding.HALF_EVEN: apytypes.QuantizationMode.RND_CONV,
        Rounding.TOWARD_ZERO: apytypes.QuantizationMode.TRN_ZERO,
    }
    return apytypes.APyFloatQuantizationContext(modes[form.rounding])


@given(data=st.data())
def test_operations_of_any_format_equal_those_of_apytypes(data):
    apytypes = pytest.importorskip("apytypes")
    form = data.draw(FORMS)
    operation = data.draw(st.sampled_from(sorted(BINARY)))
    a, b = data.draw(raws(form)), data.draw(raws(form))
    x, y = (apytypes.APyFloat.from_bits(raw, form.exponent, form.mantissa) for raw in (a, b))
    sign = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}[operation]
    with _quantisation(form):
        exact = {"+": x.__add__, "-": x.__sub__, "*": x.__mul__, "/": x.__truediv__}[sign]
        if sign == "/" and form.magnitude(b) == 0:
            return
        expected = exact(y).to_bits()
    found = BINARY[operation](form, a, b)
    assert same(form, found, expected)


@given(data=st.data())
def test_a_number_is_its_own_nearest(data):
    form = data.draw(FORMS)
    raw = data.draw(st.integers(0, form.highest)) | data.draw(st.sampled_from([0, form.sign]))
    expected = 0 if form.magnitude(raw) == 0 else raw
    assert form.nearest(form.real(raw)) == expected


@given(data=st.data())
def test_the_fused_operation_rounds_once(data):
    form = data.draw(FORMS)
    a, b, c = (
        data.draw(st.integers(0, form.highest)) | data.draw(st.sampled_from([0, form.sign])) for _ in "abc"
    )
    exact = form.real(a) * form.real(b) + form.real(c)
    found = fused_multiply_add(form, a, b, c)
    if exact:
        assert found == form.nearest(exact)
    else:
        assert form.magnitude(found) == 0


@given(data=st.data())
def test_flushed_formats_know_no_subnormals(data):
    kept = data.draw(FORMS)
    form = Float(kept.exponent, kept.mantissa, kept.rounding, subnormals=False)
    a, b = data.draw(raws(form)), data.draw(raws(form))
    for operation in BINARY.values():
        found = operation(form, a, b)
        assert found & (form.sign - 1) == 0 or found >> form.mantissa & ((1 << form.exponent) - 1)
        flushed = [raw if form.magnitude(raw) else raw & form.sign for raw in (a, b)]
        beyond = operation(kept, *flushed)
        least = Fraction(2) ** (1 - form.bias)
        if not form.is_nan(beyond) and not form.is_infinite(beyond) and abs(kept.real(beyond)) > least:
            assert found == beyond


def test_formats_that_cannot_be_are_refused():
    with pytest.raises(FormatError, match=r"float\(1, 23\)"):
        Float(1, 23)
    with pytest.raises(FormatError, match="half_up"):
        Float(8, 23, Rounding.HALF_UP)
