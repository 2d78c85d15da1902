"""What another model is in the coefficients of hardware that was built for one of its pattern."""

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Algorithm
from kalmanhdl.algorithm.loadable import UnlikeError, coefficients
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import FormatError, ModelError
from kalmanhdl.graph.operations import Coefficient
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.numerics.integers import Numbers, filter_in_units
from kalmanhdl.numerics.typed import TypedGraph

Array = NDArray[np.float64]

# For a zero where the pattern has none: far below the last bit of any format, with a square that is not zero.
_NOTHING = 1e-60
_MATRICES = ("F", "H", "Q", "R", "B", "offset", "measurement_offset")
_STARTS = ("x", "P", "from_measurement", "from_state", "from_control")


@dataclass(frozen=True, slots=True, kw_only=True)
class Word:
    """A coefficient: where it is written, what it is in the hardware's units, and as a raw integer.

    ``use`` names a number of the filter that is computed with it.
    """

    address: int
    name: str
    use: str
    value: float
    raw: int
    form: Fixed

    @property
    def error(self) -> float:
        """What rounding changed of the value."""
        return float(self.form.real(self.raw)) - self.value


def image(found: Numbers, built_for: Model, model: Model, algorithm: Algorithm) -> tuple[Word, ...]:
    """The coefficients of ``model`` in the order of their addresses.

    Raises:
        ModelError: the model has other sizes, or a number where the pattern has a zero.
        FormatError: a coefficient does not fit its format.
    """
    assert isinstance(built_for, LinearModel)
    if not isinstance(model, LinearModel):
        raise ModelError(f"a {model.kind} model has no numbers to load: give a linear one")
    if found.traced is None:
        raise ModelError('nothing is loadable here: build with [architecture] coefficients = "loadable"')
    filled = _filled(built_for, model)
    try:
        values = coefficients(
            found.traced, filled, lambda each: filter_in_units(each, algorithm, found.scaling)
        )
    except UnlikeError:
        raise ModelError(
            f'"{algorithm.kind}" takes other steps on this model than on the one that was built for: '
            "build hardware for it"
        ) from None
    return _words(found.typed, values)


def loaded(found: Numbers, words: tuple[Word, ...]) -> TypedGraph:
    """The typed graph with the coefficients of an image."""
    return found.typed.loaded({word.name: word.raw for word in words})


def _filled(built_for: LinearModel, model: LinearModel) -> LinearModel:
    """The model with what counts as nothing where it has a zero and the pattern has none."""
    own: dict[str, Any] = {key: _like(key, getattr(built_for, key), getattr(model, key)) for key in _MATRICES}
    first, second = built_for.initial, model.initial
    if (first.points, first.before_update) != (second.points, second.before_update):
        raise ModelError("model.initial.kind is another than that of the hardware: give a start of its kind")
    begun: dict[str, Any] = {
        key: _like(f"initial.{key}", getattr(first, key), getattr(second, key)) for key in _STARTS
    }
    return replace(model, initial=replace(second, **begun), **own)


def _like(key: str, pattern: Array | None, given: Array | None) -> Array | None:
    if pattern is None or given is None:
        if given is not None and np.any(given):
            raise ModelError(f"{key} is not 0: the hardware has no {key}")
        return given if pattern is None else np.where(pattern != 0.0, _NOTHING, 0.0)
    if pattern.shape != given.shape:
        shapes = (" x ".join(map(str, each.shape)) for each in (given, pattern))
        raise ModelError("{} is {}: the hardware was built for {}".format(key, *shapes))
    beyond = np.argwhere((pattern == 0.0) & (given != 0.0))
    if len(beyond):
        place = tuple(beyond[0])
        raise ModelError(
            f"{key}[{','.join(map(str, place))}] is {given[place]:.6g}, where the hardware's pattern has a "
            "zero: build hardware for a model with a number there"
        )
    return np.where((pattern != 0.0) & (given == 0.0), _NOTHING, given)


def _words(typed: TypedGraph, values: dict[str, Fraction]) -> tuple[Word, ...]:
    graph, found = typed.graph, []
    for index, (operation, form) in enumerate(zip(graph.operations, typed.formats, strict=True)):
        if isinstance(operation, Coefficient) and form is not None:
            value = values[operation.name]
            use = graph.origins[graph.users[index][0]] if graph.users[index] else graph.origins[index]
            found.append((int(operation.name[2:-1]), operation.name, use, value, form))
    return tuple(
        Word(address=k, name=name, use=use, value=float(value), raw=_raw(name, use, value, form), form=form)
        for k, (_, name, use, value, form) in enumerate(sorted(found, key=lambda each: each[0]))
    )


def _raw(name: str, use: str, value: Fraction, form: Fixed) -> int:
    raw = round(value / form.resolution)
    if not form.lowest <= raw <= form.highest:
        limit = float(form.real(form.highest if value > 0 else form.lowest))
        raise FormatError(
            f"{name} ({use}) is {float(value):.6g} but {form} ends at {limit:.6g}: build with "
            "[numerics.headroom] constant = 1 or more, or for the greater of the models"
        )
    return raw
