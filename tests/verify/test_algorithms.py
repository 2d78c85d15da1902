"""Every algorithm's Verilog against the engine, bit for bit, on small models."""

import shutil

import numpy as np
import pytest

from every_algorithm import covering
from kalmanhdl.algorithm import ALGORITHMS, LINEAR, Taylor
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import compile_design, verify
from linear_models import random_model

pytestmark = [
    pytest.mark.skipif(not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler"),
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.slow,
]


@pytest.mark.parametrize("kind", sorted(LINEAR))
@pytest.mark.parametrize(("n", "m", "width"), [(2, 1, 16), (3, 2, 24), (4, 2, 16)])
def test_every_bit_of_an_algorithm_is_equal(kind, n, m, width):
    random = np.random.default_rng(100 * n + width)
    model = random_model(random, n, m)
    design = Design(
        name=f"{kind}_{n}",
        model=model,
        # Misses in a row raise the covariances of these models far above their steady states.
        algorithm=Taylor(covering(model)) if kind == "taylor" else ALGORITHMS[kind](),
        numerics=FixedSpecification(width=width),
        architecture=Architecture(channels=3),
        target=Target(device="unit", grade=1),
    )
    runs = verify(compile_design(design), 2000)
    assert sum(run.steps for run in runs) == 2000
    assert all(run.mismatches == 0 for run in runs)
