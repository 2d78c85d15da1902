"""The extended filter: f, h and their derivatives number by number, the covariance on whole matrices."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm import Extended
from kalmanhdl.errors import ProgramError
from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.graph.operations import Input
from kalmanhdl.graph.signal import Signal, named
from kalmanhdl.math import wrap
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.processor.compiler.correlation import taken_apart
from kalmanhdl.processor.compiler.covariance import scalar_gain
from kalmanhdl.processor.compiler.graph import Array, Matrix, Vector
from kalmanhdl.processor.compiler.graph import named as noted
from kalmanhdl.processor.compiler.recipe import Anything, Given, Kept, Matrices, Recipe, near_one
from kalmanhdl.processor.compiler.samples import samples
from kalmanhdl.processor.compiler.scalars import numbers, placed

Elements = NDArray[Any]

_NOTHING: Elements = np.zeros(0, object)


def extended(model: NonlinearModel, algorithm: Extended) -> Recipe:
    """The filter of a nonlinear model without run-time inputs. Raises ProgramError for others."""
    if model.inputs:
        names = ", ".join(each.name for each in model.inputs)
        raise ProgramError(f"the run-time inputs {names} have no program: give them as constants")
    seen = samples(model)
    return Recipe(
        vectors=("x",),
        matrices=("P",),
        begin=lambda m: {},
        start=lambda m, kept, given: _started(m, model, kept, given, {"z": seen.first_z, "u": seen.first_u}),
        predict=lambda m, kept, given: _predicted(m, model, kept, given, {"x": seen.before, "u": seen.u}),
        update=lambda m, kept, given: _updated(
            m, model, kept, given, {"x": seen.predicted, "z": seen.z}, joseph=algorithm.joseph
        ),
        finish=lambda m, kept: kept,
        variances="P",
        covariance=lambda values: values["P"],
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Formulas:
    """Elements that are computed one by one, from the elements of vectors by their letters.

    ``known`` are samples (k, count) of the vectors.
    """

    m: Matrices
    where: str
    vectors: Mapping[str, Vector]
    known: Mapping[str, Array]

    def __call__(self, make: Callable[..., Mapping[str, Elements]]) -> dict[str, Elements]:
        """The arrays that ``make`` gives: floats, and matrices whose element 0 is the number."""
        builder = Builder()
        signals = {letter: _leaves(builder, letter, each.length) for letter, each in self.vectors.items()}
        arrays: dict[str, Any] = {name: np.array(each, object) for name, each in make(**signals).items()}
        varying = [
            (name, place)
            for name, array in arrays.items()
            for place in np.ndindex(*array.shape)
            if _number(array[place]) is None
        ]
        for name, array in arrays.items():
            named(f"{self.where}: {name}", array)
        outputs = [(f"{name}{place}", arrays[name][place].index) for name, place in varying]
        graph = builder.graph([], outputs)
        used = {each.name for each in graph.operations if isinstance(each, Input)}
        leaves = {
            f"{letter}[{k}]": each.picked(k)
            for letter, each in self.vectors.items()
            for k in range(each.length)
            if f"{letter}[{k}]" in used
        }
        known = {
            f"{letter}[{k}]": column for letter, each in self.known.items() for k, column in enumerate(each.T)
        }
        found = numbers(self.m, self.where, graph, leaves, known)
        for array in arrays.values():
            for place in np.ndindex(*array.shape):
                array[place] = _number(array[place])
        for (name, place), matrix in zip(varying, found, strict=True):
            arrays[name][place] = matrix
        return arrays


def _leaves(builder: Builder, letter: str, count: int) -> Elements:
    leaves = np.empty(count, object)
    for k in range(count):
        leaves[k] = Signal(builder, builder.intern(Input(f"{letter}[{k}]")))
    return leaves


def _number(element: Any) -> float | None:
    """The value of an element that is known."""
    if not isinstance(element, Signal):
        return float(element)
    value = element.builder.value(element.index)
    return None if value is None else float(value)


def _whole(m: Matrices, name: str, array: Elements) -> Anything:
    """A matrix or a vector of floats and of numbers, which are put into their places."""
    constant = np.array(
        [[0.0 if isinstance(each, Matrix) else each for each in row] for row in np.atleast_2d(array)]
    )
    base = m.c(name, constant[0] if array.ndim == 1 else constant)
    whole: Any = np.atleast_2d(array)
    places = [place for place in np.ndindex(*whole.shape) if isinstance(whole[place], Matrix)]
    found = {base.builder.size * i + j: whole[i, j] for i, j in places}
    return placed(base, found) if found else base


def _vectors(kept: Kept, given: Given, letters: str) -> dict[str, Vector]:
    found = {"x": kept.get("x"), "z": given.z, "u": given.u}
    return {letter: found[letter] for letter in letters if found[letter] is not None}


def _started(
    m: Matrices, model: NonlinearModel, kept: Kept, given: Given, known: Mapping[str, Array]
) -> Kept:
    """Mean and covariance of a start, an angle to half a turn either side."""
    nothing = np.zeros(model.n, object)

    def make(z: Elements, u: Elements = _NOTHING) -> dict[str, Elements]:
        x, P = model.start(nothing, z, u)
        return {"x": _wrapped(x, model.state_angles, model.units.state), "P": P}

    found = _Formulas(m=m, where="start", vectors=_vectors(kept, given, "zu"), known=known)(make)
    return {"x": _whole(m, "x0", found["x"]), "P": _whole(m, "P0", _mirrored(found["P"]))}


def _mirrored(P: Elements) -> Elements:
    lower = np.tril_indices(len(P), -1)
    P[lower] = P.T[lower]
    return P


def _predicted(
    m: Matrices, model: NonlinearModel, kept: Kept, given: Given, known: Mapping[str, Array]
) -> Kept:
    """f(x, u) and F P F' + Q."""
    zero = rows(model.transition(*map(elements, (np.zeros((1, model.n)), np.zeros((1, model.p))))), (1,))[0]

    def make(x: Elements, u: Elements = _NOTHING) -> dict[str, Elements]:
        F, B = model.transition_slope(x, u), _control_slope(model, x, u)
        f = _split(model.transition(x, u), zero, np.hstack([F, B]))
        return {"f": f, "F": F, "B": B, "Q": model.process_noise(x, u)}

    found = _Formulas(m=m, where="predict", vectors=_vectors(kept, given, "xu"), known=known)(make)
    straight, x, moved = _known(found["f"]), kept["x"], None
    if straight.any():
        moved = noted(_rows(m, "F_straight", found["F"], straight) @ x, "predict: x")
        if model.p:
            B = _rows(m, "B_straight", found["B"], straight)
            moved = noted(moved.plus(B, given.u), "predict: x with controls")
    F, Q = _whole(m, "F", found["F"]), _whole(m, "Q", _mirrored(found["Q"]))
    FP = noted(F @ kept["P"], "predict: F P")
    return {"x": _joined(m, "f", moved, found["f"]), "P": noted(Q.plus(FP, F), "predict: P")}


def _updated(
    m: Matrices,
    model: NonlinearModel,
    kept: Kept,
    given: Given,
    known: Mapping[str, Array],
    *,
    joseph: bool,
) -> Kept:
    """The update with h at x, in units in which S is near one."""
    D = np.diag(near_one(model))
    zero = rows(-model.observation(elements(np.zeros((1, model.n)))), (1,))[0]

    def make(x: Elements, z: Elements) -> dict[str, Elements]:
        H = model.observation_slope(x)
        y = _wrapped(z - model.observation(x), model.angles, model.units.measurement)
        return {"y": _split(y, zero, H, model.angles) * D, "H": H * D[:, None]}

    found = _Formulas(m=m, where="update", vectors=_vectors(kept, given, "xz"), known=known)(make)
    straight, x, y = _known(found["y"]), kept["x"], None
    if straight.any():
        H = _rows(m, "H_straight", found["H"], straight, 1 / D)
        y = noted(given.z.minus(H, x), "update: y")
        y = noted(m.c("D_straight", np.diag(D * straight)) @ y, "update: y in its units")
    HV = noted(_whole(m, "H_D", found["H"]).rows_where(given.V), "update: H of what is valid")
    H, y, R = taken_apart(m, HV, _joined(m, "y", y, found["y"]), given.V, np.diag(D))
    change, P = _one_by_one(m, kept["P"], (H, y, R), joseph=joseph)
    x = noted(x + change, "update: x")
    return {"x": _turned(m, model, x, known["x"]), "P": P}


def _one_by_one(
    m: Matrices, P: Anything, seen: tuple[Anything, Anything, Anything], *, joseph: bool
) -> tuple[Anything, Anything]:
    """What innovations y with variances on the diagonal of R add to x, and the P that they leave.

    One after the other, without an inverse: a reciprocal of each variance keeps more digits.
    """
    (H, y, R), size, change = seen, P.builder.size, None
    for j in range(m.model.m):
        h = noted(m.c(f"E{j}", np.diag(np.eye(m.model.m)[j])) @ H, f"update {j}: h")
        K, Ph = scalar_gain(P, h, R, j)
        if change is None:
            change = noted(K @ y, f"update {j}: change of x")
        else:
            e = noted(y.minus(h, change), f"update {j}: y")
            change = noted(change.plus(K, e), f"update {j}: change of x")
        if joseph:
            A = noted(m.c("I", np.eye(size)) - noted(K @ h, f"update {j}: K h"), f"update {j}: I - K h")
            noise = noted(noted(K @ R, f"update {j}: K r") @ K.T, f"update {j}: K r K'")
            P = noted(noise.plus(noted(A @ P, f"update {j}: A P"), A), f"update {j}: P")
        else:
            P = noted(P.minus(K, Ph), f"update {j}: P")
    return change, P


def _turned(m: Matrices, model: NonlinearModel, x: Vector, known: Array) -> Vector:
    """States that are angles brought to half a turn either side."""
    angles = sorted(model.state_angles)
    if not angles:
        return x
    found = _Formulas(m=m, where="update", vectors={"x": x}, known={"x": known})(
        lambda x: {"x": _wrapped(x, model.state_angles, model.units.state)[angles]}
    )
    return placed(x, dict(zip(angles, found["x"], strict=True)))


def _wrapped(values: Elements, angles: Collection[int], units: Array) -> Elements:
    """Values in some units, those of them that are angles brought to half a turn either side."""
    result = values.copy()
    for place in angles:
        result[place] = wrap(values[place] * units[place]) * (1 / units[place])
    return result


def _control_slope(model: NonlinearModel, x: Elements, u: Elements) -> Elements:
    """The derivative of f by u (n, p)."""
    if not model.p:
        return np.zeros((model.n, 0), object)
    d, g = model.units.state, model.units.control
    return model.f.jacobian("u", model.p)(x=x * d, u=u * g) * (g / d[:, None])


def _split(values: Elements, zero: Array, slopes: Elements, never: Collection[int] = ()) -> Elements:
    """Values, but of a row whose slopes are known what it has at zero: the rest is a product of matrices."""
    return np.array(
        [
            value if k in never or any(_number(each) is None for each in row) else float(there)
            for k, (value, there, row) in enumerate(zip(values, zero, slopes, strict=True))
        ],
        object,
    )


def _known(array: Elements) -> NDArray[np.bool_]:
    return np.array([not isinstance(each, Matrix) for each in array], bool)


def _rows(
    m: Matrices, name: str, array: Elements, chosen: NDArray[np.bool_], scale: Array | float = 1.0
) -> Matrix:
    """A constant matrix of the chosen rows, zero in the others."""
    constant = np.zeros(array.shape)
    constant[chosen] = array[chosen] * np.broadcast_to(scale, len(array))[chosen, None]
    found: Matrix = m.c(name, constant)
    return found


def _joined(m: Matrices, name: str, moved: Vector | None, array: Elements) -> Vector:
    """What is known of a vector and ``moved`` together, and numbers in their places."""
    constant = np.array([0.0 if isinstance(each, Matrix) else each for each in array], float)
    base: Vector = m.c(name, constant) if moved is None else moved
    if moved is not None and constant.any():
        base = moved + m.c(name, constant)
    found = {k: each for k, each in enumerate(array) if isinstance(each, Matrix)}
    return placed(base, found) if found else base
