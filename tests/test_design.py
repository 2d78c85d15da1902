"""A design made of objects obeys the same rules as a file."""

import subprocess
import sys

import numpy as np
import pytest

from kalmanhdl.algorithm import Conventional
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.errors import DataError, DesignError
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification

MODEL = linear_model([[1]], [[1]], [[1]], [[1]], initial=given([0], [[1]]))
PAIR = linear_model(*[np.eye(2)] * 4, initial=given([0, 0], np.eye(2)))


def test_a_design_needs_a_name_and_a_model():
    design = Design(name="level", model=MODEL)
    assert design.algorithm == Conventional()
    assert design.architecture == Architecture(interval=None, channels=1)
    assert design.target.device == "ecp5-25k"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Design(name="a b", model=MODEL), "name: 'a b' is no name: use letters, digits and _"),
        (lambda: Design(name="../x", model=MODEL), "name: '../x' is no name"),
        (lambda: Design(name="module", model=MODEL), "name: 'module' is a word of Verilog"),
        (lambda: Design(name=3, model=MODEL), "name: 3 is no name: write a string"),
        (
            lambda: Design(name="a", model=MODEL, algorithm="josef"),
            "[algorithm] kind = 'josef' is unknown: did you mean 'joseph'?",
        ),
        (
            lambda: Design(name="a", model=MODEL, numerics=FixedSpecification(scale=(1.0, 2.0))),
            "[numerics] scale has 2 numbers: one for each of the 1 states",
        ),
        (
            lambda: Design(name="a", model=MODEL, numerics=FixedSpecification(signals={"P[0,1]": 9})),
            "[numerics.signals] P[0,1] is no element of P: P is 1 x 1, and indices begin at 0",
        ),
        (
            lambda: Design(name="a", model=PAIR, numerics=FixedSpecification(signals={"P[1,0]": 9})),
            "[numerics.signals] P[1,0] is below the diagonal: write P[0,1]",
        ),
        (lambda: Architecture(interval=0), "[architecture] interval = 0: an integer from 1 to 65536"),
        (lambda: Architecture(channels=70000), "[architecture] channels = 70000: an integer from 1 to 65536"),
        (lambda: Architecture(channels=True), "[architecture] channels = True"),
        (lambda: Architecture(clock_mhz=-1.0), "[architecture] clock_mhz = -1"),
        (lambda: Design(name="a", model=3), "model = 3: a model, as linear_model or constant_velocity make"),
        (lambda: Design(name="a", model=MODEL, numerics=16), "numerics = 16: write FixedSpecification(...)"),
        (
            lambda: Design(name="a", model=MODEL, architecture={"channels": 2}),
            "architecture = {'channels': 2}: write Architecture(...)",
        ),
        (lambda: Design(name="a", model=MODEL, target="ecp5-25k"), "target = 'ecp5-25k': write Target(...)"),
        (lambda: Architecture(clock_mhz="fast"), "[architecture] clock_mhz = 'fast'"),
        (lambda: Architecture(clock_mhz=np.nan), "[architecture] clock_mhz = nan"),
        (lambda: Architecture(multiplier_blocks=-1), "[architecture] multiplier_blocks = -1"),
        (lambda: Architecture(multiplier="booths"), "[architecture] multiplier = 'booths': one of booth"),
        (lambda: Target(device=""), "[target] device = '' is unknown: there are ecp5-25k"),
        (
            lambda: Target(device="x"),
            "[target] device = 'x' is unknown: there are ecp5-25k, ecp5-45k, ecp5-85k",
        ),
        (lambda: Target(device=None), "[target] device = None is unknown"),
        (lambda: Target(grade=0), "[target] grade = 0 is unknown: the speed grades of ecp5-25k are 6, 7, 8"),
        (lambda: Target(seeds=1000), "[target] seeds = 1000: an integer from 1 to 64"),
    ],
)
def test_what_cannot_be_is_refused_with_table_key_and_value(make, message):
    with pytest.raises(DesignError) as caught:
        make()
    assert message in str(caught.value)


def test_a_design_of_objects_needs_no_pydantic():
    code = "import sys, kalmanhdl.design; raise SystemExit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", ["clk", "rst", "in_valid", "out_x_0"])
def test_a_design_is_not_named_like_a_port(name):
    with pytest.raises(DesignError, match="a name of the hardware's ports"):
        Design(name=name, model=MODEL)


@pytest.mark.parametrize("steps", [-1, 1.5, True, "10", np.array([1, 2])])
def test_a_build_is_verified_by_a_number_of_steps(tmp_path, steps):
    with pytest.raises(DesignError, match=r"verify_steps = .*: an integer from 0 to 1000000000"):
        Design(name="a", model=MODEL).build(tmp_path / "out", verify_steps=steps)
    assert not (tmp_path / "out").exists()


def test_controls_without_measurements_are_not_left_out_silently(tmp_path):
    with pytest.raises(DataError, match="u and time are given without z"):
        Design(name="a", model=MODEL).build(tmp_path / "out", u=[[1]])
