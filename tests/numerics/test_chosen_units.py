"""Units are chosen for filters that work, and for no others."""

import numpy as np
import pytest

from kalmanhdl.algorithm import Taylor
from kalmanhdl.design import Design
from kalmanhdl.errors import DesignError, FormatError
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import numbers_of
from kalmanhdl.reproduce.liu2007 import chosen_model


@pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")
def test_a_filter_that_diverges_gets_no_formats():
    design = Design(name="lost", model=chosen_model(), algorithm=Taylor(about=np.eye(4) * 1e-3))
    with np.errstate(all="ignore"), pytest.raises(FormatError, match=r"state x0 comes to .* diverges"):
        numbers_of(design)


@pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")
@pytest.mark.parametrize(
    ("numerics", "message"),
    [
        ({}, r"\[model\] Q: in units that suit .*, Q\[1,1\] = inf is not finite: bring the model's numbers"),
        ({"scale": (1.0, 1e-200)}, r"\[numerics\] scale: in these units Q\[1,1\] = inf is not finite"),
    ],
)
def test_units_beyond_doubles_are_blamed_on_whoever_chose_them(numerics, message):
    model = linear_model([[1, 1e-200], [0, 1]], [[1, 0]], np.eye(2), [[1]], initial=given([0, 0], np.eye(2)))
    design = Design(name="far", model=model, numerics=FixedSpecification(**numerics))
    with np.errstate(all="ignore"), pytest.raises(DesignError, match=message):
        numbers_of(design)
