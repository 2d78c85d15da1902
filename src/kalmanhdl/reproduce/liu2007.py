"""The experiments of liu2007: how the Taylor filter converges, and how many bits it and others need.

Liu, Bouganis & Cheung, Efficient Mapping of a Kalman Filter into an FPGA Using Taylor Expansion, 2007,
fig. 5 and 6. The paper gives n = m = 4, a run of 1000 measurements and the arrangement of its words, and
no model: ``liu2007.toml`` has one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm import Conventional, Taylor
from kalmanhdl.algorithm.filter import Algorithm
from kalmanhdl.design import Design
from kalmanhdl.explore.sweep import Row, Split, sweep
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import LinearModel, linear_model
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.report.chart import Chart, Line, Panel, Style
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.simulate.commands import commands
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.reference import reference

Array = NDArray[np.float64]

ALGORITHMS = ("taylor", "bierman_thornton", "conventional", "joseph", "sequential")
WIDTHS = tuple(range(8, 33, 2))
"""Words whose halves are whole."""
CONVERGENCE_STEPS, CONVERGENCE_TRACKS = 100, 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Convergence:
    """Root mean square error over states and tracks after each measurement of a constant. Shapes (steps,).

    ``one`` (algorithms, steps) is the first state on the first track, as fig. 5, ``true`` what it is.
    """

    taylor: Array
    optimal: Array
    one: Array
    true: float

    def within(self, error: Array, share: float = 0.1) -> int:
        """The first measurement after which the error stays below a share of the state."""
        above = np.flatnonzero(error >= share * abs(self.true))
        return int(above[-1]) + 2 if len(above) else 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Figures:
    """Fig. 5, in double precision; and fig. 6, a row for each algorithm and word length."""

    convergence: Convergence
    rows: tuple[Row, ...]


def chosen_model(states: int = 4, *, moving: bool = True) -> LinearModel:
    """As many measurements as states, six at most; without ``moving`` the constant state of section 5.1."""
    data = facts("liu2007")["model"]
    F, H = (np.array(data[name], float)[:states, :states] for name in "FH")
    unit = np.eye(states)
    return linear_model(
        F if moving else unit,
        H,
        data["q"] * unit if moving else 0.0 * unit,
        data["r"] * unit,
        initial=given(np.zeros(states), data["p"] * unit),
    )


def drawn(model: LinearModel, first: Array, steps: int, tracks: int, seed: int) -> Plots:
    """Tracks of the model from a state, and their noisy measurements."""
    random = np.random.default_rng(seed)
    x = np.broadcast_to(first, (tracks, model.n))
    truth, z = np.empty((steps, tracks, model.n)), np.empty((steps, tracks, model.m))
    for k in range(steps):
        if k:
            noise = random.standard_normal(x.shape) * np.sqrt(np.diag(model.Q))
            x = x @ model.F.T + noise
        truth[k] = x
        z[k] = x @ model.H.T + random.standard_normal(z[k].shape) * np.sqrt(np.diag(model.R))
    return Plots(
        tracks=tuple(map(str, range(tracks))),
        z=z,
        u=np.zeros((steps, tracks, 0)),
        active=np.ones((steps, tracks), bool),
        time=None,
        truth=truth,
    )


def converge(steps: int = CONVERGENCE_STEPS, tracks: int = CONVERGENCE_TRACKS, seed: int = 1) -> Convergence:
    """Fig. 5: a constant state, found by the Taylor filter about I and by the optimal one."""
    model, state = chosen_model(moving=False), np.array(facts("liu2007")["model"]["constant"])
    plots = drawn(model, state, steps, tracks, seed)
    found = [_estimates(model, algorithm, plots) for algorithm in (Taylor(about="identity"), Conventional())]
    error = [np.sqrt(((x - state) ** 2).mean(axis=(1, 2))) for x in found]
    return Convergence(
        taylor=error[0],
        optimal=error[1],
        one=np.array([x[:, 0, 0] for x in found]),
        true=float(state[0]),
    )


def _estimates(model: LinearModel, algorithm: Algorithm, plots: Plots) -> Array:
    return reference(algorithm(model), commands(model, plots.z, plots.active), plots.z, plots.u).x


def accuracy(
    widths: tuple[int, ...] = WIDTHS,
    algorithms: tuple[str, ...] = ALGORITHMS,
    progress: Progress = silent,
    seed: int = 1,
) -> tuple[Row, ...]:
    """Fig. 6: one run of measurements through every algorithm at every word length."""
    model = chosen_model()
    first = np.random.default_rng(seed).standard_normal(4) * np.sqrt(facts("liu2007")["model"]["p"])
    plots = drawn(model, first, facts("liu2007")["run"], 1, seed)
    design = Design(name="liu2007", model=model, algorithm=Taylor(about="identity"))
    return sweep(design, widths, algorithms, split=Split.HALF, data=plots, progress=progress)


def least_width(rows: tuple[Row, ...], algorithm: str) -> int | None:
    """The shortest word from which on nothing breaks; None if the longest breaks."""
    mine = sorted((row.width, row.broken) for row in rows if row.algorithm == algorithm)
    broken = [width for width, why in mine if why]
    good = [width for width, _ in mine if not broken or width > broken[-1]]
    return good[0] if good else None


def figures(progress: Progress = silent) -> Figures:
    """Fig. 5 and 6."""
    progress("convergence on a constant state")
    return Figures(convergence=converge(), rows=accuracy(progress=progress))


def reproduction(found: Figures) -> Reproduction:
    """Mean square errors by word length, where each algorithm breaks, and what the paper states."""
    widths = sorted({row.width for row in found.rows})
    kinds = tuple(dict.fromkeys(row.algorithm for row in found.rows))
    cells = {(row.algorithm, row.width): row for row in found.rows}
    rows = [(f"{width} bits", *(_cell(cells[kind, width]) for kind in kinds)) for width in widths]
    exact = [f"{cells[kind, widths[-1]].float_squared_error:.4g}" for kind in kinds]
    rows.append(("double precision", *exact))
    least = {kind: least_width(found.rows, kind) for kind in kinds}
    rows.append(("shortest word that holds", *(f"{least[kind] or 'none'}" for kind in kinds)))
    below = facts("liu2007")["ud_breaks_below"]
    stated = {"bierman_thornton": f"{below}", "taylor": f"less than {below}"}
    rows.append(("the same in the paper", *(stated.get(kind, "not given") for kind in kinds)))
    return Reproduction(
        title="Liu, Bouganis & Cheung 2007: mean square error (eq. 16) by word length; * where it breaks",
        columns=("", *kinds),
        rows=tuple(rows),
        notes=_notes(found),
        charts={
            "convergence": _convergence_chart(found.convergence),
            "accuracy": _accuracy_chart(found, kinds),
        },
    )


def _cell(row: Row) -> str:
    return f"{row.squared_error:.4g}{' *' if row.broken else ''}"


def _notes(found: Figures) -> tuple[str, ...]:
    data, seen, model = facts("liu2007")["model"], found.convergence, chosen_model()
    taylor, optimal = seen.within(seen.taylor), seen.within(seen.optimal)
    return (
        f"The paper gives no model: here F = {model.F.tolist()}, H = {model.H.tolist()}, "
        f"Q = {data['q']:g} I, R = {data['r']:g} I, x0 = 0, P0 = {data['p']:g} I. "
        "Which word length an algorithm needs depends on that choice: of three models tried this one was "
        "kept because it breaks where the paper's does; with H = I both filters of the paper need 12 bits.",
        "Every number in one format, half of its bits for the fraction, scales 1. A word breaks where a "
        "value that matters saturates, or the root mean square error of a state is twice the float one.",
        f"Convergence to a constant state {data['constant']}, mean of {CONVERGENCE_TRACKS} runs: the error "
        f"falls below a tenth of the first state after {taylor} measurements (Taylor about I) "
        f"and {optimal} (optimal).",
        'The paper: Taylor "does converge to the true value but not as fast". '
        "Fig. 5 and 6 have no numbers to compare.",
        "The paper's hardware wraps or clamps, it does not say; here everything saturates. Areas and clocks: "
        "kalmanhdl build.",
    )


def _convergence_chart(found: Convergence) -> Chart:
    n = np.arange(1.0, 1 + len(found.taylor))
    names = ("Taylor about I", "optimal")
    one = [
        Line(label=name, x=n, y=y, color=k) for k, (name, y) in enumerate(zip(names, found.one, strict=True))
    ]
    true = Line(label="true", x=n, y=np.full(len(n), found.true), color=2, style=Style.DASHED)
    mean = [
        Line(label=name, x=n, y=y, color=k)
        for k, (name, y) in enumerate(zip(names, (found.taylor, found.optimal), strict=True))
    ]
    return Chart(
        title="liu2007, fig. 5: a constant state, found",
        label="measurement",
        panels=(
            Panel(label="first state, one run", lines=(*one, true)),
            Panel(label="rms error, all states and runs", lines=tuple(mean)),
        ),
    )


def _accuracy_chart(found: Figures, kinds: tuple[str, ...]) -> Chart:
    lines = []
    for k, kind in enumerate(kinds):
        mine = [row for row in found.rows if row.algorithm == kind]
        x, y = (np.array([float(getattr(r, key)) for r in mine]) for key in ("width", "squared_error"))
        lines.append(Line(label=kind.replace("_", " "), x=x, y=y, color=k, style=Style.MARKED))
        bad = np.array([bool(row.broken) for row in mine])
        lines.append(Line(label="broken" if k == 0 else "", x=x[bad], y=y[bad], color=k, style=Style.RINGS))
    x = np.array(sorted({float(row.width) for row in found.rows}))
    float_error = next(row.float_squared_error for row in found.rows if row.algorithm == "conventional")
    double = Line(label="double precision", x=x, y=np.full(len(x), float_error), color=6, style=Style.DASHED)
    panel = Panel(label="mean square error", lines=(*lines, double), logarithmic=True)
    return Chart(title="liu2007, fig. 6: accuracy against word length", label="bits", panels=(panel,))
