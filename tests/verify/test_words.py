"""Raw integers through the words of a port and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.verify.words import columns, values_of, words_of

# Around whole words a sign is easily lost, or found where there is none.
WIDTHS = st.one_of(st.sampled_from([1, 63, 64, 65, 127, 128, 129, 192]), st.integers(1, 400))


@st.composite
def raws_of_a_format(draw):
    width = draw(WIDTHS)
    form = Fixed(width=width, fraction=0, signed=draw(st.booleans()) and width > 1)
    numbers = st.one_of(st.sampled_from([form.lowest, form.highest]), st.integers(form.lowest, form.highest))
    return form, draw(st.lists(numbers, min_size=1, max_size=5))


def stored(raws: list[int], kind: type) -> np.ndarray:
    try:
        return np.array(raws, kind)
    except OverflowError:
        return np.array(raws, object)


@given(raws_of_a_format(), st.sampled_from([np.int64, np.uint64, object]))
def test_raw_integers_of_every_width_come_back(given_raws, kind):
    form, raws = given_raws
    words = words_of(stored(raws, kind), form.width)
    assert words.dtype == np.uint64
    for raw, row in zip(raws, words.tolist(), strict=True):
        assert sum(word << 64 * k for k, word in enumerate(row)) == raw % (1 << form.width)
    seen = values_of(words, form.width, form)
    assert [int(raw) for raw in seen] == raws
    # As the engine has them, or differing: NumPy compares them exactly.
    assert not (seen != stored(raws, kind)).any()
    assert (seen != stored([raw ^ 1 for raw in raws], object)).all()


@pytest.mark.parametrize("form", [Float(exponent=11, mantissa=52), Float(exponent=15, mantissa=112)])
def test_an_encoded_float_has_no_sign(form):
    raws = [(1 << form.width) - 1, 1 << (form.width - 1), 0]
    words = words_of(np.array(raws, object), form.width)
    assert [int(raw) for raw in values_of(words, form.width, form)] == raws


def test_each_port_starts_a_new_word():
    words = np.arange(8, dtype=np.uint64).reshape(2, 4)
    found = columns(words, (("a", 64), ("b", 65), ("c", 1)))
    assert {name: each.tolist() for name, each in found.items()} == {
        "a": [[0], [4]],
        "b": [[1, 2], [5, 6]],
        "c": [[3], [7]],
    }
