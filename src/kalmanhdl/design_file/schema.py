"""The tables of a design file, one pydantic model each; unknown keys are errors."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictBool

from kalmanhdl.algorithm import ALGORITHMS, Converted, Extended, Scheduled, Taylor
from kalmanhdl.algorithm.converted import At as ConvertedAt
from kalmanhdl.arithmetic.fixed import Overflow, Rounding
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.design import SOLVER_SECONDS, Coefficients, Streams
from kalmanhdl.design_file.values import (
    Axes,
    Entries,
    EntryMatrix,
    EntryRows,
    Inputs,
    Integer,
    Interval,
    Matrix,
    Names,
    Noise,
    Number,
    Point,
    Scale,
    Steps,
    Vector,
    Written,
)
from kalmanhdl.model.conversion import Unbiasing
from kalmanhdl.model.initial import At
from kalmanhdl.model.motion import Discretisation, Order
from kalmanhdl.model.multiple import MultipleModel
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.numerics.choices import AUTO
from kalmanhdl.numerics.specification import DEFAULT_WIDTH


class Table(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class RootTable(Table):
    """The file itself."""

    name: str
    model: dict[str, Any]
    algorithm: dict[str, Any] = Field(default_factory=dict)
    numerics: dict[str, Any] = Field(default_factory=dict)
    architecture: dict[str, Any] = Field(default_factory=dict)
    target: dict[str, Any] = Field(default_factory=dict)


class CommonModelTable(Table):
    """What every kind of model says."""

    kind: str
    R: Matrix
    initial: dict[str, Any]
    constants: dict[str, Any] = Field(default_factory=dict)
    unit: Names | None = None
    measurement: Names | None = None
    measurement_offset: Vector | None = None
    measurement_range: Matrix | None = None
    coordinates: Literal["cartesian", "polar", "spherical"] = "cartesian"


class LinearTable(CommonModelTable):
    """``kind = "linear"``: the matrices themselves."""

    F: Matrix
    H: Matrix
    Q: Matrix
    B: Matrix | None = None
    offset: Vector | None = None
    state: Names | None = None
    control: Names | None = None


class VaryingTable(Table):
    """``kind = "linear"`` with ``inputs``, which formulas in the matrices name."""

    kind: str
    # Before the matrices, whose entries are formulas in them.
    inputs: Inputs
    F: EntryMatrix
    H: Matrix
    Q: EntryMatrix
    R: EntryMatrix
    initial: dict[str, Any]
    B: EntryMatrix | None = None
    offset: Entries | None = None
    state: Names | None = None
    control: Names = Field(default_factory=list)
    constants: dict[str, Any] = Field(default_factory=dict)
    unit: Names | None = None
    measurement: Names | None = None
    measurement_offset: Vector | None = None
    measurement_range: Matrix | None = None


class MotionTable(CommonModelTable):
    """``kind = "constant_velocity"`` or ``"constant_acceleration"``, with measured positions."""

    T: Number
    noise: Noise
    axes: Axes = 1
    discretisation: Discretisation = "piecewise"
    order: Order = "axis"


class SingerTable(MotionTable):
    """``kind = "singer"``."""

    tau: Number
    discretisation: Discretisation = "continuous"


class TurnTable(MotionTable):
    """``kind = "coordinated_turn"``."""

    turn_rate: Number
    noise: Number
    axes: Axes = 2


class MultipleTable(Table):
    """``kind = "multiple"``: modes that switch; what the file says beside these keys goes for every mode."""

    kind: str
    modes: list[dict[str, Any]]
    transition: Matrix
    probabilities: Vector | None = None
    constants: dict[str, Any] = Field(default_factory=dict)


class NonlinearTable(Table):
    """``kind = "nonlinear"``: formulas in states, controls, inputs and constants."""

    kind: str
    # Before the matrices, whose entries are formulas where there are inputs.
    inputs: Inputs = Field(default_factory=list)
    f: Entries
    h: Entries
    Q: EntryMatrix
    R: EntryMatrix
    state: Names
    measurement: Names
    initial: dict[str, Any]
    G: EntryRows | None = None
    control: Names = Field(default_factory=list)
    angles: Names = Field(default_factory=list)
    unit: Names | None = None
    measurement_range: Matrix | None = None
    constants: dict[str, Any] = Field(default_factory=dict)


class MeasuredTable(Table):
    """``kind = "measured"``, of a nonlinear model: formulas in the measurements of the first row."""

    kind: str
    x: Entries
    P: Matrix


class GivenTable(Table):
    """``kind = "given"``."""

    kind: str
    x: Vector
    P: Matrix
    at: At = "first"


class TwoPointTable(Table):
    """``kind = "two_point"``."""

    kind: str
    P: Matrix | None = None


class ThreePointTable(TwoPointTable):
    """``kind = "three_point"``."""


class AffineTable(Table):
    """``kind = "affine"``: the general form, x := x + from_measurement z + from_state (x kept before)
    + from_control u; P := P + from_noise R from_noise'."""

    kind: str
    x: Vector
    P: Matrix
    from_measurement: Matrix
    from_state: Matrix
    from_control: Matrix | None = None
    from_noise: Matrix | None = None
    points: Integer = 1
    before_update: StrictBool = False


class AlgorithmTable(Table):
    """How the estimate is computed, by an algorithm without options."""

    kind: str


class ConvertedTable(AlgorithmTable):
    """``kind = "converted_measurement"``."""

    unbiasing: Unbiasing = "debiased"
    at: ConvertedAt = "measurement"


class ScheduledTable(AlgorithmTable):
    """``kind = "scheduled"``."""

    steps: Steps = "auto"


class TaylorTable(AlgorithmTable):
    """``kind = "taylor"``."""

    about: Point = "steady_state"
    newton: Integer = 0


class ExtendedTable(AlgorithmTable):
    """``kind = "extended"``."""

    joseph: StrictBool = False


class FixedTable(Table):
    """``kind = "fixed"``: fixed-point arithmetic."""

    kind: str = "fixed"
    width: Integer = DEFAULT_WIDTH
    rounding: Rounding = Rounding.FLOOR
    overflow: Overflow = Overflow.SATURATE
    state: Written = None
    covariance: Written = None
    gain: Written = None
    measurement: Written = None
    control: Written = None
    innovation: Written = None
    innovation_covariance: Written = None
    reciprocal: Written = None
    nis: Written = None
    constant: Written = None
    product: Written = None
    scale: Scale = AUTO
    covariance_scale: Scale = AUTO
    division: Written = "radix2"
    functions: Written = AUTO
    coast: Integer = 5
    signals: Written = Field(default_factory=dict)
    headroom: dict[str, Integer] = Field(default_factory=dict)

    def classes(self, names: tuple[str, ...]) -> dict[str, Any]:
        """The formats of the signal classes that the file gives."""
        given = {name: getattr(self, name) for name in names}
        return {name: form for name, form in given.items() if form is not None}


class FloatTable(Table):
    """``kind = "float"``: floating-point arithmetic, its format by a word or by its sizes."""

    kind: str
    format: str | None = None
    exponent: Integer | None = None
    mantissa: Integer | None = None
    rounding: Rounding = Rounding.HALF_EVEN
    subnormals: StrictBool = True
    fused: StrictBool = False


class ArchitectureTable(Table):
    """``kind = "datapath"``: hardware of the filter's own; how fast, and for how many tracks."""

    kind: Literal["datapath"] = "datapath"
    control: Literal["fixed"] = "fixed"
    interval: Interval = "bound"
    channels: Integer = 1
    clock_mhz: Number | None = None
    multiplier_blocks: Integer | None = None
    multiplier: LogicProduct = LogicProduct.BOOTH
    units: dict[str, Integer] | None = None
    latency: Integer | None = None
    clocks: dict[str, Integer] | None = None
    iterative: tuple[str, ...] = ()
    updates_per_second: Number | None = None
    solver_seconds: Number = SOLVER_SECONDS
    lanes: Integer = 1
    streams: Streams = Streams.ONE
    coefficients: Coefficients = Coefficients.FIXED


class WritableTable(Table):
    """``control = "writable"``: a programmable datapath, whose control store is written."""

    kind: Literal["datapath"] = "datapath"
    control: Literal["writable"]
    units: dict[str, Integer] = Field(default_factory=dict)
    rows: Integer = 256
    words: Integer = 128
    operand_width: Integer = 18
    word_width: Integer = 48
    # As many as the model has.
    states: Integer | None = None
    measurements: Integer | None = None
    controls: Integer | None = None
    reciprocal_table: Integer | None = None


class ProcessorTable(Table):
    """``kind = "processor"``: the programmable matrix processor."""

    kind: Literal["processor"]
    size: Integer | None = None
    width: Integer | None = None
    fraction: Integer | None = None
    multipliers: Integer | None = None
    matrices: Integer = 64
    program_words: Integer = 512


class TargetTable(Table):
    """The device."""

    device: str = "ecp5-25k"
    grade: Integer = 6
    seeds: Integer = 4
    rounds: Integer = 0
    derate: dict[str, Number] = Field(default_factory=dict)


MODELS: dict[str, type[CommonModelTable]] = {
    "linear": LinearTable,
    "constant_velocity": MotionTable,
    "constant_acceleration": MotionTable,
    "singer": SingerTable,
    "coordinated_turn": TurnTable,
}
MODEL_KINDS = (*MODELS, NonlinearModel.kind, MultipleModel.kind)
"""Every kind of model; those not in MODELS have tables that no mode of another model can be."""
INITIALS: dict[str, type[Table]] = {
    "given": GivenTable,
    "two_point": TwoPointTable,
    "three_point": ThreePointTable,
    "affine": AffineTable,
}
NONLINEAR_INITIALS: dict[str, type[Table]] = {**INITIALS, "measured": MeasuredTable}
ARCHITECTURES = ("datapath", "processor")
CONTROLS = ("fixed", "writable")
# Algorithms with options have a table of their own, whose keys are the algorithm's fields.
ALGORITHM_TABLES: dict[str, type[AlgorithmTable]] = {
    **dict.fromkeys(ALGORITHMS, AlgorithmTable),
    Converted.kind: ConvertedTable,
    Extended.kind: ExtendedTable,
    Scheduled.kind: ScheduledTable,
    Taylor.kind: TaylorTable,
}
NUMERICS: dict[str, type[Table]] = {"fixed": FixedTable, "float": FloatTable}
