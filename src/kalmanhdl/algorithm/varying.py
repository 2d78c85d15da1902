"""Algorithms for linear models, on models whose matrices may vary from step to step."""

from collections.abc import Callable

from kalmanhdl.algorithm.filter import Algorithm, Filter, unsuited
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.model.varying import VaryingModel


def of_linear(model: Model, algorithm: Algorithm, make: Callable[[LinearModel], Filter]) -> Filter:
    """The filter that ``make`` makes of a linear model, or of the one that each step's inputs say.

    Raises ModelError where the model is neither linear nor varying.
    """
    match model:
        case LinearModel():
            return make(model)
        case VaryingModel():
            return _step_by_step(model, make)
        case _:
            raise unsuited(model, algorithm)


def _step_by_step(model: VaryingModel, make: Callable[[LinearModel], Filter]) -> Filter:
    fixed = make(model.fixed)
    return Filter(
        kept=fixed.kept,
        start=lambda memory, given: make(model.at(given.u)).start(memory, given),
        predict=lambda memory, given: make(model.at(given.u)).predict(memory, given),
        update=lambda memory, given: make(model.at(given.u)).update(memory, given),
        estimate=fixed.estimate,
        before_update=fixed.before_update,
        shown=fixed.shown,
    )
