"""A format is given to a signal that the hardware computes, and to no other."""

import re

import numpy as np
import pytest

from kalmanhdl.algorithm import Conventional
from kalmanhdl.errors import DesignError
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.integers import numbers
from kalmanhdl.numerics.specification import FixedSpecification

PAIR = linear_model(*[np.eye(2)] * 4, initial=given([0, 0], np.eye(2)))


def typed(*signals):
    return numbers(PAIR, Conventional(), FixedSpecification(signals=dict.fromkeys(signals, 6))).typed


@pytest.mark.parametrize("signal", ["Q[0,0]", "R[0,0]", "F[0,1]", "P[0,1]", "nothing[3]"])
def test_a_format_for_what_is_not_computed_is_refused(signal):
    """P[0,1] of two decoupled states stays zero for ever."""
    with pytest.raises(DesignError, match=rf"\[numerics.signals\] {re.escape(signal)} is a constant here"):
        typed(signal)


@pytest.mark.parametrize("signal", ["x[0]", "z[1]", "y[0]", "P[1,1]", "S[0,0]", "K[1,1]"])
def test_a_format_for_what_is_computed_is_taken(signal):
    assert typed(signal).formats != typed().formats
