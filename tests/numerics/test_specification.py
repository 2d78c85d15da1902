"""What a design asks of its formats."""

import pytest

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import DesignError
from kalmanhdl.numerics.functions.method import Interpolation
from kalmanhdl.numerics.specification import FixedSpecification, parse_format


def test_a_signals_own_format_goes_before_its_class_and_the_width():
    wide = Fixed(width=40, fraction=8)
    spec = FixedSpecification(width=20, classes={"covariance": 24}, signals={"P[0,1]": wide})
    assert spec.form("covariance", "P[0,1]") == wide
    assert spec.form("covariance", "P[0,0]") == 24
    assert spec.form("state", "x[0]") == 20


def test_a_signals_own_headroom_goes_before_its_class():
    spec = FixedSpecification(headroom={"covariance": 2, "P[0,1]": 5})
    assert [spec.room("covariance", name) for name in ("P[0,1]", "P[0,0]")] == [5, 2]
    assert spec.room("state", "x[0]") == 0


def test_widths_not_given_are_the_default_but_for_constants_and_nis():
    spec = FixedSpecification(width=20)
    assert [spec.form(name) for name in ("state", "gain", "constant", "nis")] == [20, 20, 18, 16]
    assert FixedSpecification().form("state") == 16


@pytest.mark.parametrize(
    ("text", "form"),
    [
        ("Q12.20", Fixed(width=32, fraction=20)),
        ("UQ12.20", Fixed(width=32, fraction=20, signed=False)),
        ("Q-3.11", Fixed(width=8, fraction=11)),
        ("Q20.-4", Fixed(width=16, fraction=-4)),
        ("Q0.0", None),
        ("Q1024.1", None),
        ("q1.1", None),
        ("Q1", None),
    ],
)
def test_q_notation_counts_the_sign_among_the_integer_bits(text, form):
    assert parse_format(text) == form


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width": 0}, "[numerics] width = 0: a width is an integer from 1 to 1024"),
        ({"classes": {"covarience": 8}}, "covarience is no signal class: did you mean 'covariance'?"),
        ({"classes": {"gain": 1025}}, "[numerics] gain = 1025"),
        ({"classes": {"gain": Fixed(width=8, fraction=5000)}}, "a fraction is an integer from -4096 to 4096"),
        ({"signals": {"P": 8}}, "[numerics.signals] 'P' is no signal"),
        ({"signals": {"P[0,0]": True}}, "[numerics.signals] P[0,0] = True: a width is an integer"),
        ({"headroom": {"P": 1}}, "[numerics.headroom] 'P' is neither a signal"),
        ({"headroom": {"gain": -1}}, "[numerics.headroom] gain = -1: an integer from 0 to 64"),
        ({"scale": (1.0, 0.0)}, "[numerics] scale = 0: a scale is a positive number"),
        ({"covariance_scale": float("inf")}, "[numerics] covariance_scale = inf"),
        ({"division": LongDivision(radix=8)}, "[numerics] division radix 8: radix 2 or 4"),
        ({"division": TableNewton(index_bits=30, iterations=0)}, "an index has 1 to 16 bits"),
        ({"division": TableNewton(index_bits=8, iterations=9)}, "0 to 8 iterations"),
        ({"division": "radix2"}, "[numerics] division = 'radix2'"),
        ({"functions": "cordic"}, '[numerics] functions = \'cordic\': "auto", "cordic" or { table = 8 }'),
        (
            {"functions": Interpolation(index_bits=13)},
            "[numerics] functions table = 13: an index has 1 to 12 bits",
        ),
    ],
)
def test_what_cannot_be_is_refused(arguments, message):
    with pytest.raises(DesignError) as caught:
        FixedSpecification(**arguments)
    assert message in str(caught.value)
