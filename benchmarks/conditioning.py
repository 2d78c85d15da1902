"""Every algorithm on problems that lose the digits of a double, with filterpy beside them.

The greatest relative error of P after one update, against exact values: the problem of Dyer & McReynolds
(H = [1 1 1; 1 1 1+d], R = d^2 I, P0 = I) and that of Bierman (H = [1 eps; 1 1], R = I, P0 = I / eps^2),
with d and eps = 2^-k. "In single": by the bit-exact engine in single precision.
Run: ``python benchmarks/conditioning.py``.
"""

import csv
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from filterpy.kalman import KalmanFilter, SquareRootKalmanFilter
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from kalmanhdl.algorithm import Algorithm, BiermanThornton, Conventional, Joseph, Sequential
from kalmanhdl.errors import FormatError
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.floating import FloatSpecification, float_numbers
from kalmanhdl.simulate.data import plots_from_arrays
from kalmanhdl.simulate.reference import reference
from kalmanhdl.simulate.side_by_side import simulate

Array = NDArray[np.float64]
Update = Callable[[Array, Array, Array], Array]

DATA = Path(__file__).parents[1] / "tests" / "data"
ALGORITHMS: tuple[Algorithm, ...] = (Conventional(), Joseph(), Sequential(), BiermanThornton())


def by_algorithm(algorithm: Algorithm) -> Update:
    """P after one update from P0 by an algorithm of kalmanhdl."""

    def update(H: Array, R: Array, P0: Array) -> Array:
        n, m = len(P0), len(H)
        model = linear_model(np.eye(n), H, np.zeros((n, n)), R, initial=given(np.zeros(n), P0))
        start = np.zeros((1, 1), np.int8)
        return reference(algorithm(model), start, np.zeros((1, 1, m)), np.zeros((1, 1, 0))).P[0, 0]

    return update


def in_single(algorithm: Algorithm) -> Update:
    """P after one update from P0 by an algorithm, every operation rounded to single precision."""
    single = FloatSpecification(exponent=8, mantissa=23)

    def update(H: Array, R: Array, P0: Array) -> Array:
        n, m = len(P0), len(H)
        model = linear_model(np.eye(n), H, np.zeros((n, n)), R, initial=given(np.zeros(n), P0))
        numbers = float_numbers(model, algorithm, single)
        data = plots_from_arrays(np.zeros((1, 1, m)), model)
        return simulate(model, algorithm(model), numbers, data).exact.P[0, 0]

    return update


def by_filterpy(kind: type) -> Update:
    """P after one update from P0 by a filter of filterpy."""

    def update(H: Array, R: Array, P0: Array) -> Array:
        kalman = kind(dim_x=len(P0), dim_z=len(H))
        kalman.H, kalman.R, kalman.P = H, R, P0
        kalman.update(np.zeros((len(H), 1)))
        return np.asarray(kalman.P)

    return update


def problems() -> list[tuple[str, int, tuple[Array, Array, Array], Array]]:
    """Name, k, (H, R, P0) and the exact P of every problem."""
    found = []
    for row in _rows("dyer_mcreynolds_illconditioned_exact.csv"):
        d = 2.0 ** -int(row[1])
        H = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + d]])
        found.append(
            ("Dyer & McReynolds", int(row[1]), (H, d * d * np.eye(2), np.eye(3)), _whole(row[2:], 3))
        )
    for row in _rows("bierman_epsilon_exact.csv"):
        eps = 2.0 ** -int(row[0])
        H = np.array([[1.0, eps], [1.0, 1.0]])
        found.append(("Bierman", int(row[0]), (H, np.eye(2), np.eye(2) / eps**2), _whole(row[1:], 2)))
    return found


def _rows(name: str) -> list[list[str]]:
    with (DATA / name).open() as file:
        return list(csv.reader(file))[1:]


def _whole(numbers: list[str], n: int) -> Array:
    P = np.zeros((n, n))
    P[np.triu_indices(n)] = [float(number) for number in numbers]
    return np.triu(P) + np.triu(P, 1).T


def error(update: Update, problem: tuple[Array, Array, Array], exact: Array) -> str:
    """The greatest relative error, or why there is none."""
    try:
        worst = float(np.abs(update(*problem) / exact - 1).max())
    except np.linalg.LinAlgError:
        return "singular"
    except FormatError:
        return "out of range"
    return f"{worst:.0e}" if np.isfinite(worst) else "no number"


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    columns = {algorithm.kind: by_algorithm(algorithm) for algorithm in ALGORITHMS}
    columns["bierman_thornton in single"] = in_single(BiermanThornton())
    columns["filterpy"] = by_filterpy(KalmanFilter)
    columns["filterpy square root"] = by_filterpy(SquareRootKalmanFilter)
    table = Table("problem", "k", *columns)
    for name, k, problem, exact in problems():
        if k % 4 == 2:
            table.add_row(name, str(k), *(error(update, problem, exact) for update in columns.values()))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
