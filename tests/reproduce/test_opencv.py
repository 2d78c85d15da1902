"""OpenCV's filter, which is timed, does what the reference does."""

import numpy as np
import pytest

from kalmanhdl.algorithm import Conventional
from kalmanhdl.reproduce.liu2007 import chosen_model, drawn
from kalmanhdl.reproduce.opencv import PRECISIONS, timed
from kalmanhdl.simulate.commands import commands
from kalmanhdl.simulate.reference import reference

cv2 = pytest.importorskip("cv2")


@pytest.mark.parametrize("states", [3, 4, 6])
def test_opencv_estimates_what_the_reference_does_on_one_thread_and_leaves_the_others(states):
    model, threads = chosen_model(states), cv2.getNumThreads()
    plots = drawn(model, np.zeros(states), 200, 1, 1)
    found = timed(model, plots.z[:, 0])
    expected = reference(Conventional()(model), commands(model, plots.z, plots.active), plots.z, plots.u)
    assert [run.precision for run in found] == list(PRECISIONS)
    for run, most in zip(found, (1e-5, 1e-12), strict=True):
        np.testing.assert_allclose(run.x, expected.x[-1, 0], atol=most)
        assert run.seconds_per_step > 0
    assert cv2.getNumThreads() == threads
