"""What a design asks of its formats."""

import numpy as np
import pytest

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.errors import DesignError
from kalmanhdl.numerics.choices import parse_format
from kalmanhdl.numerics.functions.method import Cordic, Interpolation
from kalmanhdl.numerics.specification import FixedSpecification


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
        ({"division": "radix8"}, '[numerics] division = \'radix8\': write "radix2", "radix4" or { table'),
        ({"division": {"tabel": 8}}, "[numerics] division = {'tabel': 8}: write"),
        ({"division": {"table": "x"}}, "[numerics] division table = 'x': an index has 1 to 16 bits"),
        ({"division": TableNewton(index_bits=8, iterations=None)}, "division newton = None"),
        ({"division": LongDivision(radix="4")}, "[numerics] division radix '4': radix 2 or 4"),
        ({"division": np.array([1, 2])}, "[numerics] division = array([1, 2])"),
        (
            {"functions": "cordik"},
            '[numerics] functions = \'cordik\': write "auto", "cordic" or { table = 8 }',
        ),
        ({"functions": Interpolation(index_bits=2.5)}, "functions table = 2.5: an index has 1 to 12 bits"),
        ({"classes": 5}, "[numerics] classes = 5: write a format by name"),
        ({"classes": {3: 8}}, "[numerics] 3 is no signal class"),
        ({"classes": {"gain": "Q4"}}, "[numerics] gain: 'Q4' is no format: write a width like 16, a format"),
        ({"classes": {"gain": {"widht": 4}}}, "'widht' is no key of a format: did you mean 'width'?"),
        ({"classes": {"gain": {"width": 4}}}, "gain: {'width': 4} is no format: write a width"),
        ({"classes": {"gain": None}}, "[numerics] gain = None: a width is an integer"),
        ({"signals": 5}, "[numerics] signals = 5: write a format by name, such as"),
        ({"signals": {1: 5}}, "[numerics.signals] 1 is no signal"),
        ({"headroom": [1]}, "[numerics] headroom = [1]: write bits by name"),
        ({"width": "Q4.8"}, "[numerics] width = 'Q4.8': a width is an integer"),
        ({"width": 16.5}, "[numerics] width = 16.5"),
        ({"scale": 3.0}, '[numerics] scale: 3 is no list: write "auto" or one number a state'),
        ({"scale": np.array(["a"])}, "[numerics] scale = 'a': a scale is a positive number"),
        ({"scale": np.array([1.0, np.nan])}, "[numerics] scale = nan"),
        ({"scale": {"x": 1}}, "[numerics] scale = {'x': 1}: a scale is a positive number"),
        ({"scale": "autp"}, "[numerics] scale = 'autp': a scale is a positive number, or \"auto\""),
        ({"coast": "5"}, "[numerics] coast = '5': an integer from 0 to 32"),
        ({"rounding": [1]}, "[numerics] rounding = [1]: one of floor"),
        ({"overflow": np.array([1, 2])}, "[numerics] overflow = array([1, 2]): one of wrap"),
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


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ({"width": np.int64(20)}, {"width": 20}),
        ({"width": 20.0}, {"width": 20}),
        ({"coast": np.uint8(3)}, {"coast": 3}),
        ({"classes": {"state": "Q4.8"}}, {"classes": {"state": Fixed(width=12, fraction=8)}}),
        (
            {"signals": {"P[0,0]": {"width": np.int32(9), "fraction": 1, "signed": np.bool_(False)}}},
            {"signals": {"P[0,0]": Fixed(width=9, fraction=1, signed=False)}},
        ),
        ({"headroom": {"gain": np.int16(2)}}, {"headroom": {"gain": 2}}),
        ({"scale": [1, 2]}, {"scale": (1.0, 2.0)}),
        ({"scale": np.array([1, 2])}, {"scale": (1.0, 2.0)}),
        ({"covariance_scale": np.array([1.0, 2.0])}, {"covariance_scale": (1.0, 2.0)}),
        ({"covariance_scale": np.float32(0.5)}, {"covariance_scale": 0.5}),
        ({"division": "radix4"}, {"division": LongDivision(radix=4)}),
        ({"division": {"table": np.int64(9)}}, {"division": TableNewton(index_bits=9, iterations=0)}),
        ({"functions": "cordic"}, {"functions": Cordic()}),
        ({"functions": "auto"}, {"functions": None}),
        ({"functions": {"table": 8}}, {"functions": Interpolation(index_bits=8)}),
        (
            {"rounding": "half_up", "overflow": "wrap"},
            {"rounding": Rounding.HALF_UP, "overflow": Overflow.WRAP},
        ),
    ],
)
def test_words_of_a_file_and_numbers_of_numpy_are_taken(written, meant):
    found, expected = FixedSpecification(**written), FixedSpecification(**meant)
    assert found == expected
    assert repr(found) == repr(expected)


def test_what_a_specification_was_made_of_may_change_later():
    signals = {"P[0,0]": 20}
    spec = FixedSpecification(signals=signals)
    signals["P[0,0]"] = 3
    assert spec.signals == {"P[0,0]": 20}
