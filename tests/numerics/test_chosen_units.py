"""Units are chosen for filters that work, and for no others."""

import numpy as np
import pytest

from kalmanhdl.algorithm import Taylor
from kalmanhdl.design import Design
from kalmanhdl.errors import FormatError
from kalmanhdl.pipeline import numbers_of
from kalmanhdl.reproduce.liu2007 import chosen_model


@pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")
def test_a_filter_that_diverges_gets_no_formats():
    design = Design(name="lost", model=chosen_model(), algorithm=Taylor(about=np.eye(4) * 1e-3))
    with np.errstate(all="ignore"), pytest.raises(FormatError, match=r"state x0 comes to .* diverges"):
        numbers_of(design)
