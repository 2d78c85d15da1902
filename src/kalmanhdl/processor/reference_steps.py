"""What a filter's program puts out beside the float reference on the same numbers, row after row."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalmanhdl.errors import DataError
from kalmanhdl.model.model import Array
from kalmanhdl.processor.compiler.constants import numbers_read
from kalmanhdl.processor.fit import Fitted
from kalmanhdl.simulate.commands import Command, commands
from kalmanhdl.simulate.reference import reference


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceSteps:
    """x and the variances after every row in the units of the model, (steps, 2 n) each; NaN before a start.

    ``names`` and ``units`` (2 n) belong to the columns.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    exact: Array
    reference: Array

    @property
    def off(self) -> Array:
        """How far apart the two are."""
        return np.asarray(np.abs(self.exact - self.reference))


def reference_steps(fit: Fitted, tokens: Sequence[int], sent: Sequence[int]) -> ReferenceSteps:
    """The rows that were put out, of the raw numbers that a program read and those that it put out.

    The reference gets the measurements as the program does, so that what is between them is its arithmetic.
    Raises DataError where the rows do not begin with a start.
    """
    model, scaling = fit.given, fit.scaling
    n, m, p = model.n, model.m, model.p
    numbers = fit.core.numbers.reals(tokens[len(numbers_read(fit.filter_, fit.core)) :])
    rows = numbers[: len(numbers) // (2 * m + p) * (2 * m + p)].reshape(-1, 2 * m + p)
    z = np.where(rows[:, :m] != 0, rows[:, m : 2 * m] * scaling.measurement, np.nan)[:, None]
    u = (rows[:, 2 * m :] * scaling.control)[:, None]
    given = commands(model, z, np.ones((len(z), 1), bool))
    if np.any(given == Command.NONE):
        raise DataError(
            f"the first {model.initial.points} rows of the input start the track: "
            "give them all their measurements"
        )
    found = reference(fit.design.algorithm(model), given, z, u)
    variances = found.P[:, 0][:, range(n), range(n)]
    whole = len(sent) // (2 * n)
    exact = np.reshape(fit.core.numbers.reals(sent[: 2 * n * whole]), (whole, 2 * n))
    points = model.initial.points - 1
    shown = np.arange(whole)[:, None] >= points
    units = np.concatenate([scaling.state, np.diag(scaling.covariances())])
    names = tuple(name.replace("_", " ") for name in model.state_names)
    return ReferenceSteps(
        names=(*names, *(f"variance of {name}" for name in names)),
        units=(*model.state_units, *(f"({unit})²" if unit else "" for unit in model.state_units)),
        exact=np.where(shown, exact * units, np.nan),
        reference=np.where(shown, np.hstack([found.x[:, 0], variances])[:whole], np.nan),
    )
