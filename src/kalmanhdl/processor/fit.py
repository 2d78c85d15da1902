"""A design on the processor: its units, the core and the format that it needs, and its program."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalmanhdl.algorithm import Algorithm, Conventional, Joseph, Taylor, steady_state
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.design import Design, Processor
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.model import Array
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.ranges import Plots, simulated
from kalmanhdl.numerics.scaling import Scaling
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.numerics.units import units
from kalmanhdl.processor.compiler.constants import numbers_read
from kalmanhdl.processor.compiler.covariance import ADJUGATE
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import compiled, equipped, fitting
from kalmanhdl.processor.compiler.recipe import Filtered
from kalmanhdl.processor.compiler.samples import samples
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.follow import Rows, as_data, rows_of
from kalmanhdl.processor.program import Program
from kalmanhdl.validation import InvalidValueError

_TRIED_TRACKS, _TRIED_STEPS = 6, 32
_HEADROOM = 1
"""Bits above the point that the numbers of the tried tracks leave free, where the tool places the point."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A design's filter in the units of the hardware, the core that it runs on, and its program.

    ``model`` and ``algorithm`` are those in these units.
    """

    design: Design
    scaling: Scaling
    model: Filtered
    algorithm: Algorithm
    core: Core
    filter_: Traced
    program: Program

    @property
    def given(self) -> Filtered:
        """The design's model, in its own units."""
        assert isinstance(self.design.model, LinearModel | NonlinearModel)
        return self.design.model


def fitted(design: Design) -> Fitted:
    """The program of a design with a processor.

    Raises DesignError, naming the key, for what the processor has no program for or what does not fit it.
    """
    processor = design.processor
    assert processor is not None
    model = design.model
    if not isinstance(model, LinearModel | NonlinearModel):
        rule = 'the processor has programs for linear and nonlinear models: use "datapath" for it'
        raise InvalidValueError("model", "kind", f' = "{model.kind}": {rule}')
    plots = simulated(model, coast(design), _TRIED_STEPS, _TRIED_TRACKS)
    scaling = _scaling(design, model, plots)
    inner = model.in_units(scaling)
    algorithm = _in_units(design.algorithm, model, scaling)
    size = processor.size or _size(inner, algorithm)
    try:
        cores = _cores(processor, design, size)
        # Where the point stands makes the program no longer.
        filter_ = fitting(inner, algorithm, cores(processor.fraction or processor.bits // 2))

        def tried(core: Core) -> Sequence[Rows]:
            return rows_of(core, model, scaling, as_data(plots))

        core = _chosen(processor, lambda fraction: equipped(cores(fraction), filter_), filter_, tried)
        numbers_read(filter_, core)
        program = compiled(filter_, core)
    except ProgramError as error:
        raise InvalidValueError("architecture", "kind", f' = "processor": {error}') from None
    return Fitted(
        design=design,
        scaling=scaling,
        model=inner,
        algorithm=algorithm,
        core=core,
        filter_=filter_,
        program=program,
    )


def coast(design: Design) -> int:
    """Measurements that tracks drawn from the model miss in a row at most."""
    numerics = design.numerics
    return (numerics if isinstance(numerics, FixedSpecification) else FixedSpecification()).coast


def _scaling(design: Design, model: Filtered, plots: Plots) -> Scaling:
    """Of fixed-point numbers powers of two that suit the design; floats have the model's own units."""
    if isinstance(design.numerics, FixedSpecification):
        return units(model, design.algorithm(model), _scaled(design.numerics, model), plots)
    return Scaling(
        state=np.ones(model.n),
        measurement=np.ones(model.m),
        control=np.ones(model.p),
        covariance=np.ones(model.n),
    )


def _scaled(numerics: FixedSpecification, model: Filtered) -> FixedSpecification:
    """Where the tool chooses: powers of two near the settled deviations, as all variances share a format.

    In these units variances are near one, whatever a measurement's are that is no state.
    """
    if isinstance(model, NonlinearModel) and numerics.covariance_scale == "auto":
        numerics = replace(numerics, covariance_scale=1.0)
    if numerics.scale != "auto":
        return numerics
    deviations = _deviations(model)
    powers = 2.0 ** np.round(np.log2(np.where(deviations > 0, deviations, 1.0)))
    return replace(numerics, scale=tuple(map(float, powers)))


def _deviations(model: Filtered) -> Array:
    if isinstance(model, NonlinearModel):
        return samples(model).deviations
    return np.asarray(np.sqrt(np.diag(steady_state.steady_prior(model))))


def _in_units(algorithm: Algorithm, model: Filtered, scaling: Scaling) -> Algorithm:
    if not isinstance(algorithm, Taylor):
        return algorithm
    assert isinstance(model, LinearModel)
    point = algorithm.point(model) / scaling.covariances()
    return Taylor(tuple(tuple(map(float, row)) for row in point), newton=algorithm.newton)


def _size(model: Filtered, algorithm: Algorithm) -> int:
    inverts = isinstance(algorithm, Conventional | Joseph) and 1 < model.m <= ADJUGATE
    return max(2, model.n, model.m, model.p, ADJUGATE if inverts else 0)


def _cores(processor: Processor, design: Design, size: int) -> Callable[[int], Core]:
    """The core of a design by the bits behind its point, which floats have not."""
    few = isinstance(design.numerics, FloatSpecification)
    usual = size if few else size * size
    multipliers = usual if processor.multipliers is None else processor.multipliers
    if multipliers % size or multipliers > size**3:
        raise InvalidValueError(
            "architecture",
            "multipliers",
            f" = {multipliers}: a multiple of the matrices' size, {size}, up to {size**3}; 0: eight clocks",
        )
    numerics = design.numerics
    fixed = numerics if isinstance(numerics, FixedSpecification) else FixedSpecification()

    def core(fraction: int) -> Core:
        form: Fixed | Float = Fixed(width=processor.bits, fraction=fraction)
        return Core(
            form=numerics.form if isinstance(numerics, FloatSpecification) else form,
            rounding=fixed.rounding,
            overflow=fixed.overflow,
            matrices=processor.matrices,
            program_words=processor.program_words,
            size=size,
            extended=True,
            units=multipliers // size,
        )

    return core


def _chosen(
    processor: Processor,
    core: Callable[[int], Core],
    filter_: Traced,
    tried: Callable[[Core], Sequence[Rows]],
) -> Core:
    """The core with the design's place of the point, or with the one that some tracks ask for."""
    if core(0).floating:
        return _with_range(filter_, core(0), tried)
    if processor.fraction is not None:
        return core(processor.fraction)
    # Too many bits behind the point saturate, and so may too few, where a variance is rounded to nothing.
    for fraction in range(processor.bits - 2, 0, -1):
        if _holds(filter_, core(fraction), tried):
            roomier = core(fraction - _HEADROOM)
            return roomier if _holds(filter_, roomier, tried) else core(fraction)
    raise InvalidValueError(
        "architecture", "width", f" = {processor.bits}: no place of the point holds the filter's numbers"
    )


def _with_range(filter_: Traced, core: Core, tried: Callable[[Core], Sequence[Rows]]) -> Core:
    """A core of floats, which tracks do not leave."""
    numbers_read(filter_, core)
    if not _holds(filter_, core, tried):
        problem = f"on tracks drawn from the model results leave {core.form}"
        remedy = "take more bits for the exponent, or other units"
        raise InvalidValueError("numerics", "kind", f' = "float": {problem}: {remedy}')
    return core


def _holds(filter_: Traced, core: Core, tried: Callable[[Core], Sequence[Rows]]) -> bool:
    """Whether the constants and everything computed on some tracks are numbers of the core's format."""
    most = core.numbers.limits[1]
    if any(np.abs(constant).max(initial=0.0) > most for constant in filter_.constants.values()):
        return False
    if not filter_.exponents <= set(core.exponents):
        return False
    for rows in tried(core):
        engine = _engine(filter_, core)
        if engine is None:
            return False
        for row in rows:
            engine.step(row)
            if engine.saturated:
                return False
    return True


def _engine(filter_: Traced, core: Core) -> Engine | None:
    """None where nothing would be left of a constant."""
    try:
        return Engine(filter_, core)
    except ProgramError:
        return None
