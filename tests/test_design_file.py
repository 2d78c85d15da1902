"""Design files: what they say, what they may not say, and the way back to text."""

from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given as forall
from hypothesis import settings
from hypothesis import strategies as st

from kalmanhdl.algorithm import Converted
from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.design_file import dump, dumps, loads
from kalmanhdl.errors import DesignError, ModelError, OutputError
from kalmanhdl.model.converted import ConvertedModel
from kalmanhdl.model.initial import given, three_point, two_point
from kalmanhdl.model.motion import constant_acceleration, constant_velocity
from kalmanhdl.model.singer import singer
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.model.turn import coordinated_turn
from kalmanhdl.numerics.functions.method import Cordic, Interpolation
from kalmanhdl.numerics.specification import SIGNAL_CLASSES, FixedSpecification
from kalmanhdl.target import DERATED

DESIGNS = Path(__file__).parents[1] / "designs"

LEVEL = """
name = "level"

[model]
kind = "linear"
state = ["level"]
measurement = ["gauge"]
F = [[1]]
H = [[1]]
Q = [["q^2"]]
R = [[4]]
constants = { q = 0.5 }

[model.initial]
kind = "given"
x = [0]
P = [[100]]

[numerics]
gain = 10
"""


def assert_same(a, b):
    """Equal to the last bit, arrays included."""
    if is_dataclass(a):
        assert type(a) is type(b)
        for field in fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, tuple):
        for one, other in zip(a, b, strict=True):
            assert_same(one, other)
    elif isinstance(a, np.ndarray):
        np.testing.assert_array_equal(a, b)
    else:
        assert a == b


@pytest.mark.parametrize("path", sorted(DESIGNS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_design_of_the_repository_loads_and_comes_back_from_its_text(path):
    design = Design.load(path)
    assert design.name == path.stem
    assert_same(loads(dumps(design)), design)


def test_a_file_says_the_same_as_objects():
    model = linear_model(
        *([[1]], [[1]], [[0.25]], [[4]]),
        initial=given([0], [[100]]),
        state_names=["level"],
        measurement_names=["gauge"],
    )
    design = Design(name="level", model=model, numerics=FixedSpecification(classes={"gain": 10}))
    assert_same(loads(LEVEL), design)


def test_motion_models_are_reachable_from_files():
    text = """
        name = "plane"
        [model]
        kind = "constant_velocity"
        axes = ["east", "north"]
        T = "1/4"
        noise = [1, "sqrt(4)"]
        discretisation = "continuous"
        R = { diagonal = [9, 9] }
        [model.initial]
        kind = "two_point"
    """
    model = loads(text).model
    motion = constant_velocity(T=0.25, noise=[1, 2], axes=["east", "north"], discretisation="continuous")
    np.testing.assert_array_equal(model.Q, motion.Q)
    assert model.state_names == ("east", "east_rate", "north", "north_rate")
    assert model.measurement_names == ("east_plot", "north_plot")
    assert model.initial.points == 2


@pytest.mark.parametrize(
    ("keys", "motion"),
    [
        (
            'kind = "singer"\ntau = "1/0.001"\nnoise = 0.0129\naxes = 3\norder = "derivative"',
            singer(T=0.25, tau=1000, noise=0.0129, axes=3, order="derivative"),
        ),
        (
            'kind = "singer"\ntau = 2\nnoise = [1, 2]\naxes = 2\ndiscretisation = "piecewise"',
            singer(T=0.25, tau=2, noise=[1, 2], axes=2, discretisation="piecewise"),
        ),
        (
            'kind = "coordinated_turn"\nturn_rate = "-pi/60"\nnoise = 1',
            coordinated_turn(T=0.25, turn_rate=-np.pi / 60, noise=1),
        ),
        (
            'kind = "constant_acceleration"\nnoise = 1\naxes = 2\norder = "derivative"',
            constant_acceleration(T=0.25, noise=1, axes=2, order="derivative"),
        ),
    ],
)
def test_every_motion_is_reachable_from_files_and_comes_back(keys, motion):
    n, m = len(motion.F), len(motion.axes)
    text = f"""
        name = "target"
        [model]
        T = 0.25
        {keys}
        R = {{ diagonal = {[9] * m} }}
        [model.initial]
        kind = "given"
        x = {[0] * n}
        P = {{ diagonal = {[1] * n} }}
    """
    design = loads(text)
    np.testing.assert_array_equal(design.model.F, motion.F)
    np.testing.assert_array_equal(design.model.Q, motion.Q)
    np.testing.assert_array_equal(design.model.H, motion.H)
    assert design.model.state_names == motion.state_names
    assert_same(loads(dumps(design)), design)


POLAR = """
name = "boat"
[model]
kind = "constant_velocity"
axes = ["north", "east"]
T = 2
noise = 1
coordinates = "polar"
R = { diagonal = [9, "0.02^2"] }
measurement_range = [[1, 100], ["-pi", "pi"]]
[model.initial]
kind = "two_point"
[algorithm]
kind = "converted_measurement"
"""


def test_converted_measurements_are_reachable_from_files_and_come_back():
    text = POLAR + 'unbiasing = "modified"\nat = "better"'
    design = loads(text)
    assert isinstance(design.model, ConvertedModel)
    assert design.algorithm == Converted(unbiasing="modified", at="better")
    assert design.model.measurement_names == ("range", "bearing")
    assert design.model.variances == (9.0, 0.02**2)
    assert design.model.initial.points == 2
    assert design.model.initial.from_noise.shape == (4, 4)
    assert_same(loads(dumps(design)), design)


def test_three_points_are_reachable_from_files():
    text = """
        name = "target"
        [model]
        kind = "singer"
        T = 1
        tau = 10
        noise = 1
        R = [[4]]
        [model.initial]
        kind = "three_point"
    """
    design = loads(text)
    motion = singer(T=1, tau=10, noise=1)
    assert_same(
        design.model.initial, linear_model(motion.F, motion.H, motion.Q, [[4]], initial=three_point()).initial
    )
    assert_same(loads(dumps(design)), design)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"polar"', '"spherical"', "coordinates = 'spherical' takes 3 axes: range, azimuth, elevation"),
        ('"polar"', '"log"', "coordinates = 'log': write 'cartesian', 'polar' or 'spherical'"),
        ("measurement_range = ", "measurement_offset = [1, 0]\nmeasurement_range = ", "measurement_offset"),
        ('measurement_range = [[1, 100], ["-pi", "pi"]]', "", "measurement_range is missing: a start from"),
        (
            '{ diagonal = [9, "0.02^2"] }',
            "[[9, 0.01], [0.01, 1]]",
            "have independent noises: make R diagonal",
        ),
        ('{ diagonal = [9, "0.02^2"] }', "{ diagonal = [9, 11] }", "the variance of azimuth, 11, is from 0"),
        (
            '"converted_measurement"',
            '"joseph"',
            'does not suit a converted model: use "converted_measurement"',
        ),
        (
            '"converted_measurement"',
            '"converted_measurement"\nat = "truth"',
            "at = 'truth': write 'measurement'",
        ),
    ],
)
def test_converted_measurements_that_cannot_be_are_refused(old, new, message):
    text = POLAR.replace(old, new)
    with pytest.raises(DesignError) as caught:
        loads(text)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("line", "spec"),
    [
        ("width = 20", FixedSpecification(width=20)),
        ('width = "4*5"', FixedSpecification(width=20)),
        ('state = "Q12.20"', FixedSpecification(classes={"state": Fixed(width=32, fraction=20)})),
        (
            "gain = { width = 9, fraction = 8, signed = false }",
            FixedSpecification(classes={"gain": Fixed(width=9, fraction=8, signed=False)}),
        ),
        ('rounding = "half_even"', FixedSpecification(rounding=Rounding.HALF_EVEN)),
        ('overflow = "wrap"', FixedSpecification(overflow=Overflow.WRAP)),
        ('functions = "auto"', FixedSpecification()),
        ('functions = "cordic"', FixedSpecification(functions=Cordic())),
        ("functions = { table = 6 }", FixedSpecification(functions=Interpolation(index_bits=6))),
        ('division = "radix4"', FixedSpecification(division=LongDivision(radix=4))),
        (
            "division = { table = 10, newton = 1 }",
            FixedSpecification(division=TableNewton(index_bits=10, iterations=1)),
        ),
        ('scale = ["2^-3"]', FixedSpecification(scale=(0.125,))),
        ("covariance_scale = 100", FixedSpecification(covariance_scale=100.0)),
        ('signals = { "P[0,0]" = 30 }', FixedSpecification(signals={"P[0,0]": 30})),
        ("headroom = { reciprocal = 2 }", FixedSpecification(headroom={"reciprocal": 2})),
    ],
)
def test_formats_are_spelt(line, spec):
    assert loads(LEVEL.replace("gain = 10", line)).numerics == spec


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("gain = 10", "gian = 10", "line 20: [numerics] gian is an unknown key: did you mean 'gain'?"),
        ("gain = 10", 'gain = "Q3"', "line 20: [numerics] gain: 'Q3' is no format: write a width like 16"),
        ("gain = 10", "width = 5000", "line 20: [numerics] width = 5000: a width is an integer"),
        ("gain = 10", 'rounding = "up"', "[numerics] rounding = 'up': write 'floor', 'half_up', 'half_even'"),
        ("gain = 10", 'kind = "floating"', "[numerics] kind = 'floating' is unknown: did you mean 'float'?"),
        ("gain = 10", "scale = 3", 'line 20: [numerics] scale: 3 is no list: write "auto" or'),
        ("F = [[1]]", "F = [[nan]]", "line 8: [model] F[0][0]: nan is not finite: write a finite number"),
        ("F = [[1]]", "F = [[true]]", "line 8: [model] F[0][0]: True is no number"),
        ("F = [[1]]", "F = [[1, 2]]", "line 8: [model] F is 1 x 2: F is square"),
        ("F = [[1]]\n", "", "line 4: [model] F is missing"),
        ("R = [[4]]", "R = [[-4]]", "line 11: [model] R[0,0] = -4: a variance is greater than 0"),
        ('"q^2"', '"r^2"', "line 10: [model] Q[0][0]: the name 'r' is unknown: valid are q, pi, e"),
        ("q = 0.5", 'q = "q"', "line 12: [model.constants] q: the constants refer to each other in a cycle"),
        ("q = 0.5", "pi = 3", "[model] constants: 'pi' has a meaning of its own in expressions"),
        ('"given"', '"givn"', "line 15: [model.initial] kind = 'givn' is unknown: did you mean 'given'?"),
        ("P = [[100]]", "P = [[1, 2], [3]]", "line 17: [model.initial] P[1] has 1 numbers but [0] has 2"),
        ('"gauge"]', '"time"]', "line 7: [model] measurement: 'time' is a column of its own in data files"),
        ('name = "level"', 'name = "wire"', "line 2: name: 'wire' is a word of Verilog"),
        ('name = "level"', "", "name is missing"),
        ('name = "level"', "name = ", "not TOML: Invalid value (at line 2"),
        ('name = "level"', "name = 5", "line 2: name = 5: write a string"),
        ('kind = "linear"', 'kind = "nonlinaer"', "kind = 'nonlinaer' is unknown: did you mean 'nonlinear'?"),
        ('kind = "linear"', 'kind = "multple"', "kind = 'multple' is unknown: did you mean 'multiple'?"),
        ('kind = "linear"', "", "coordinated_turn, nonlinear, multiple"),
        (
            '"given"',
            '"measured"',
            "kind = 'measured' is unknown: valid are given, two_point, three_point, aff",
        ),
        ("gain = 10", 'scale = "aut"', "[numerics] scale: 'aut' is unknown: did you mean 'auto'?"),
        ("gain = 10", 'scale = "2^r"', "scale: the name 'r' is unknown: valid are q"),
        (
            "gain = 10",
            'gain = { width = "q + 8.5", fraction = "r" }',
            "gain: {'fraction': 'r', 'width': 9.0} is no",
        ),
        ("gain = 10", 'division = "radix8"', "line 20: [numerics] division = 'radix8': write \"radix2\""),
        ("gain = 10", "signals = 5", "line 20: [numerics] signals = 5: write a format by name, such as"),
        (
            "gain = 10",
            '[architecture]\ninterval = "bond"',
            "interval: 'bond' is unknown: did you mean 'bound'?",
        ),
        ("gain = 10", '[architecture]\ninterval = "2 +"', "line 21: [architecture] interval: "),
        ("gain = 10", "headroom = 5", "headroom = 5: write a table, with its keys below [numerics.headroom]"),
        (
            "gain = 10",
            'headroom = { gain = "x" }',
            "line 20: [numerics.headroom] gain: the name 'x' is unknown: did you mean 'exp'?",
        ),
        (
            "F = [[1]]",
            "F = [\n  [1]\n]\nF = [\n  [2]\n]",
            "line 11: not TOML: model.F stands in line 8 already",
        ),
        (
            "q = 0.5",
            "q = 0.5, q = 1",
            "line 12: not TOML: model.constants.q stands twice: remove one of the two",
        ),
        ("gain = 10", "gain = 10\ngain = 9", "line 21: not TOML: numerics.gain stands in line 20 already"),
        ("gain = 10", "[model]", "line 20: not TOML: model stands in line 4 already: remove one of the two"),
        (
            'F = [[1]]\nH = [[1]]\nQ = [["q^2"]]\nR = [[4]]',
            'F = [\n  # a row = a state ]\n  [1]\n]\nH = [[1]]\nQ = [["q^2"]]\nR = [[-4]]',
            "line 14: [model] R[0,0] = -4",
        ),
    ],
)
def test_an_error_names_file_line_table_key_value_and_remedy(old, new, message):
    assert old in LEVEL
    with pytest.raises(DesignError) as caught:
        loads(LEVEL.replace(old, new), "level.toml")
    assert str(caught.value).startswith("level.toml")
    assert message in str(caught.value)


LINEAR = 'kind = "linear"\nF = [[1]]\nH = [[1]]\nQ = [[1]]\nR = [[1]]\n'
MODES = 'kind = "multiple"\ntransition = [[1]]\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('model = "x"', "line 2: model = 'x': write a table, with its keys below [model]"),
        (
            f"numerics = 5\n[model]\n{LINEAR}",
            "line 2: numerics = 5: write a table, with its keys below [nume",
        ),
        (f"[model]\n{LINEAR}initial = 1", "initial = 1: write a table, with its keys below [model.initial]"),
        (f"[model]\n{MODES}modes = [5]", "modes = 5: write a table, with its keys below [[model.modes]]"),
        (f"[model]\n{MODES}modes = 5", "line 5: [model] modes = 5: write a list like [...]"),
        (f'algorithm = {{ kind = "extended", joseph = 1 }}\n{LEVEL[16:]}', "joseph = 1: true or false"),
    ],
)
def test_a_value_of_another_kind_is_told_what_to_write(text, message):
    with pytest.raises(DesignError) as caught:
        loads(f'name = "level"\n{text}')
    assert message in str(caught.value)


def test_a_start_from_measurements_is_offered_to_nonlinear_models():
    text = (DESIGNS / "ekf_radar.toml").read_text()
    unknown = " = 'measurd' is unknown: did you mean 'measured'?"
    missing = " is missing: valid are given, two_point, three_point, affine, measured"
    for kind, hint in (("", missing), ('kind = "measurd"', unknown)):
        with pytest.raises(DesignError) as caught:
            loads(text.replace('kind = "measured"', kind))
        assert f"[model.initial] kind{hint}" in str(caught.value)


def test_an_error_in_the_model_is_a_model_error():
    with pytest.raises(ModelError):
        loads(LEVEL.replace("R = [[4]]", "R = [[-4]]"))


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DesignError, match=r"missing\.toml: cannot be read: No such file"):
        Design.load(tmp_path / "missing.toml")


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        dump(loads(LEVEL), tmp_path / "nowhere" / "level.toml")


floats = st.floats(-1e6, 1e6, allow_subnormal=False).map(lambda x: x + 0.0)
positive = st.floats(1e-6, 1e6)
forms = st.integers(1, 64) | st.builds(
    Fixed, width=st.integers(1, 64), fraction=st.integers(-9, 99), signed=st.booleans()
)


@st.composite
def models(draw):
    n, m, p = draw(st.integers(1, 3)), draw(st.integers(1, 3)), draw(st.integers(0, 2))
    chance = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    root_q, root_r = chance.normal(size=(n, n)), chance.normal(size=(m, m))
    R = root_r @ root_r.T + np.eye(m)
    if draw(st.booleans()):
        motion = constant_velocity(T=draw(st.floats(0.1, 9)), noise=draw(positive), axes=m)
        return linear_model(motion.F, motion.H, motion.Q, R, initial=two_point())
    rows = st.lists(floats, min_size=n, max_size=n)
    return linear_model(
        np.eye(n) + np.diag(draw(rows)),
        np.ones((m, n)),
        root_q @ root_q.T,
        R,
        initial=given(draw(rows), np.diag(np.abs(draw(rows)))),
        B=chance.normal(size=(n, p)),
        offset=draw(rows),
        state_units=["m/s"] * n,
        measurement_range=[[-1, 1]] * m,
    )


@st.composite
def designs(draw):
    model = draw(models())
    one_each = st.lists(positive, min_size=model.n, max_size=model.n).map(tuple)
    numerics = FixedSpecification(
        width=draw(st.integers(1, 1024)),
        classes=draw(st.dictionaries(st.sampled_from(SIGNAL_CLASSES), forms)),
        signals=draw(st.dictionaries(st.sampled_from(["x[0]", "P[0,0]", "K[0,0]"]), forms)),
        headroom=draw(st.dictionaries(st.sampled_from(["gain", "P[0,0]"]), st.integers(0, 64))),
        rounding=draw(st.sampled_from(Rounding)),
        overflow=draw(st.sampled_from(Overflow)),
        scale=draw(st.just("auto") | one_each),
        covariance_scale=draw(st.just("auto") | positive | one_each),
        functions=draw(
            st.sampled_from([None, Cordic()]) | st.builds(Interpolation, index_bits=st.integers(1, 12))
        ),
        division=draw(
            st.builds(LongDivision, radix=st.sampled_from([2, 4]))
            | st.builds(TableNewton, index_bits=st.integers(1, 16), iterations=st.integers(0, 8))
        ),
    )
    blocks = st.none() | st.integers(0, 99)
    clock_mhz = draw(st.none() | st.floats(1, 900))
    return Design(
        name="drawn",
        model=model,
        algorithm=draw(st.sampled_from(["conventional", "joseph"])),
        numerics=numerics,
        architecture=Architecture(
            interval=draw(st.none() | st.integers(1, 99)),
            channels=draw(st.integers(1, 65536)),
            clock_mhz=clock_mhz,
            multiplier_blocks=draw(blocks),
            multiplier=draw(st.sampled_from(LogicProduct)),
        ),
        target=Target(
            device=draw(st.sampled_from(["ecp5-25k", "ecp5-85k"])),
            grade=8,
            seeds=1,
            rounds=draw(st.integers(0, 16)) if clock_mhz else 0,
            derate=draw(st.dictionaries(st.sampled_from(DERATED), st.floats(1, 10), max_size=3)),
        ),
    )


@pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")
@settings(max_examples=60, deadline=None)
@forall(designs())
def test_every_design_comes_back_from_its_text_to_the_last_bit(design):
    assert_same(loads(dumps(design)), design)


@pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")
def test_the_largest_model_comes_back_from_its_text(tmp_path):
    chance = np.random.default_rng(0)
    root = chance.normal(size=(64, 64))
    Q = root @ root.T + np.eye(64)
    model = linear_model(root / 10, chance.normal(size=(64, 64)), Q, Q, initial=given(np.zeros(64), Q))
    design = Design(name="largest", model=model)
    dump(design, tmp_path / "largest.toml")
    assert_same(Design.load(tmp_path / "largest.toml"), design)


def test_the_excerpt_of_the_readme_is_the_design_whose_figures_stand_beside_it():
    """But for the units of its states, which only reports show."""
    readme = (DESIGNS.parent / "README.md").read_text(encoding="utf-8")
    excerpt = loads(readme.partition("```toml\n")[2].partition("```")[0])
    whole = Design.load(DESIGNS / "lee1997.toml")
    lines = [line for line in dumps(whole).splitlines() if not line.startswith("unit =")]
    assert dumps(excerpt).splitlines() == lines


@pytest.mark.parametrize("word", ["\n", "multi\tply", "\x1b[31m", "w" * 5000])
def test_a_key_that_is_a_users_own_word_is_shown_on_one_short_line(word):
    for make in (
        lambda: Architecture(units={word: 1}),
        lambda: FixedSpecification(signals={word: 8}),
        lambda: FixedSpecification(classes={word: 8}),
        lambda: FixedSpecification(headroom={word: 1}),
    ):
        with pytest.raises(DesignError) as caught:
            make()
        message = str(caught.value)
        assert message.isprintable()
        assert len(message) < 1000
