"""A design made of objects obeys the same rules as a file."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.algorithm import Conventional
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.design import Architecture, Design, Processor, Target
from kalmanhdl.errors import DataError, DesignError, FormatError
from kalmanhdl.model.initial import given
from kalmanhdl.model.motion import constant_velocity
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.specification import FixedSpecification

MODEL = linear_model([[1]], [[1]], [[1]], [[1]], initial=given([0], [[1]]))
MOTION = constant_velocity(T=1, noise=1)
DESIGN = Path(__file__).parent / "errors" / "good.toml"
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
        (lambda: Design(name="a", model=3), "model = 3: a model, as linear_model makes one of a"),
        (lambda: Design(name="a", model=MODEL, numerics=16), "numerics = 16: write FixedSpecification(...)"),
        (
            lambda: Design(name="a", model=MODEL, architecture={"channels": 2}),
            "architecture = {'channels': 2}: write Architecture(...)",
        ),
        (lambda: Design(name="a", model=MODEL, target="ecp5-25k"), "target = 'ecp5-25k': write Target(...)"),
        (
            lambda: Architecture(interval="bond"),
            "[architecture] interval = 'bond': an integer from 1 to 65536",
        ),
        (lambda: Architecture(interval=1.5), "[architecture] interval = 1.5: an integer from 1 to 65536"),
        (lambda: Architecture(interval=np.array([1, 2])), "interval = array([1, 2]): an integer"),
        (lambda: Architecture(channels=None), "[architecture] channels = None"),
        (lambda: Architecture(iterative=5), "[architecture] iterative = 5: write a list of kinds, such as"),
        (
            lambda: Architecture(iterative="divide"),
            "[architecture] iterative = 'divide': write a list of kin",
        ),
        (lambda: Architecture(iterative=[5], units={"divide": 1}), "iterative = 5: valid are multiply, div"),
        (
            lambda: Architecture(iterative=["divide"]),
            "iterative = 'divide': how many there are is said by un",
        ),
        (lambda: Architecture(units=5), "[architecture] units = 5: write a count for each kind"),
        (lambda: Architecture(units={5: 1}), "[architecture.units] 5 is unknown: valid are add"),
        (
            lambda: Architecture(clocks={"add": 1.5}),
            "[architecture.clocks] add = 1.5: an integer from 1 to 99",
        ),
        (lambda: Architecture(streams=np.array([1, 2])), "[architecture] streams = array([1, 2]): valid are"),
        (lambda: Architecture(coefficients=None), "[architecture] coefficients = None: valid are fixed"),
        (lambda: Architecture(multiplier=np.array([1, 2])), "[architecture] multiplier = array([1, 2]): one"),
        (lambda: Architecture(solver_seconds=None), "[architecture] solver_seconds = None: a number from 0"),
        (lambda: Architecture(updates_per_second=10**400), "a rate lies between 0 and"),
        (lambda: Processor(size="3"), "[architecture] size = '3': an integer from 2 to 16"),
        (lambda: Processor(matrices=None), "[architecture] matrices = None: an integer from 2 to 512"),
        (lambda: Processor(width=16, fraction=17), "[architecture] fraction = 17: an integer from 0 to 16"),
        (lambda: Processor(matrices=3), "[architecture] matrices = 3: a power of two from 2 to 512"),
        (
            lambda: FloatSpecification(format="singel"),
            "[numerics] format = 'singel' is unknown: did you mean",
        ),
        (lambda: FloatSpecification(format=5), "[numerics] format = 5 is unknown: valid are half"),
        (lambda: FloatSpecification(exponent=8), "[numerics] mantissa is missing: write it, or format ="),
        (lambda: FloatSpecification(exponent="8", mantissa=23), "[numerics] exponent = '8': an integer"),
        (
            lambda: FloatSpecification(format="half", rounding=5),
            "rounding = 5: one of half_even, toward_zero",
        ),
        (lambda: FloatSpecification(format="half", fused=1), "[numerics] fused = 1: true or false"),
        (lambda: Design(name="a", model=type(MODEL)), "model = <class"),
        (lambda: Design(name="a", model=MOTION), "a model, as linear_model makes one of a motion's F, Q and"),
        (lambda: Design(name="a", model=MODEL, algorithm=Conventional), "[algorithm] kind = <class"),
        (lambda: Design(name="a", model=MODEL, algorithm=["x"]), "[algorithm] kind = ['x'] is unknown"),
        (lambda: Design.load(5), "5: cannot be read"),
        (lambda: Design.load(DESIGN, 5), "constants = 5: write numbers by name"),
        (lambda: Design.load(DESIGN, {5: 1}), "constant 5 is none of the design"),
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


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        (Architecture(interval="bound"), Architecture()),
        (Architecture(interval=np.int64(2)), Architecture(interval=2)),
        (Architecture(interval=2.0), Architecture(interval=2)),
        (Architecture(channels=np.uint8(4), lanes=np.int32(2)), Architecture(channels=4, lanes=2)),
        (Architecture(clock_mhz=np.float32(100)), Architecture(clock_mhz=100.0)),
        (Architecture(units={"divide": np.int64(1)}), Architecture(units={"divide": 1})),
        (
            Architecture(units={"divide": 1}, iterative=["divide"]),
            Architecture(units={"divide": 1}, iterative=("divide",)),
        ),
        (
            Architecture(units={"divide": 1}, iterative=np.array(["divide"])),
            Architecture(units={"divide": 1}, iterative=("divide",)),
        ),
        (Architecture(multiplier="wallace"), Architecture(multiplier=LogicProduct.WALLACE)),
        (Architecture(updates_per_second=np.int64(5)), Architecture(updates_per_second=5.0)),
        (Processor(size=np.int64(3)), Processor(size=3)),
        (Target(grade=np.int64(7), seeds=2.0), Target(grade=7, seeds=2)),
        (FloatSpecification(format="single"), FloatSpecification(exponent=8, mantissa=23)),
        (
            FloatSpecification(
                exponent=np.int64(5), mantissa=10.0, fused=np.bool_(True), rounding="toward_zero"
            ),
            FloatSpecification(format="half", fused=True, rounding=Rounding.TOWARD_ZERO),
        ),
        (Fixed(width=np.int64(70), fraction=np.int8(3), signed=np.bool_(True)), Fixed(width=70, fraction=3)),
    ],
)
def test_words_of_a_file_and_numbers_of_numpy_are_kept_as_python_numbers(written, meant):
    assert written == meant
    assert repr(written) == repr(meant)


@pytest.mark.parametrize(
    "sizes", [{"width": "8"}, {"width": 8.5}, {"fraction": None}, {"signed": 1}, {"width": 0}]
)
def test_a_format_that_cannot_be_is_refused(sizes):
    with pytest.raises(FormatError):
        Fixed(**{"width": 8, "fraction": 0, **sizes})


def test_a_constant_of_a_file_may_be_a_number_of_numpys():
    model = Design.load(DESIGN, {"T": np.float32(2)}).model
    assert model.F[0, 1] == 2.0


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
