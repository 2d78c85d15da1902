"""The experiment of kumar2014: the radar filter of lee1997 in Q12.20 settles on a constant.

Kumar & Aggarwal, Speed and Hardware Optimization of ORDP Algorithm Based Kalman Filter for 2D Object
Tracking, 2014. Section 4.1 prints the state after the first and the tenth sample, from a start at 10 and
rest. It gives neither T nor variances nor the first covariance. The gain G21 = P12 / (P12 + sigma^2) as
printed is no gain of a Kalman filter; here it is P21 / (P11 + sigma^2), lee1997 eq. 17.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.algorithm import Conventional
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.design import Design
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.state_space import Initial, InitialRule, LinearModel, linear_model
from kalmanhdl.numerics.specification import SIGNAL_CLASSES, FixedSpecification
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.report.chart import Chart, Line, Panel, Style
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.reproduction import Reproduction

Array = NDArray[np.float64]

Q12_20 = Fixed(width=32, fraction=20)
SAMPLES = 30


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Settling:
    """Range, rate, bearing and rate after each sample. Shapes (samples, 4).

    ``reference`` in double precision, ``exact`` the bit-exact engine in Q12.20. ``saturations``: values that
    mattered and did not fit.
    """

    constants: str
    reference: Array
    exact: Array
    saturations: int

    @property
    def apart(self) -> float:
        """How far the engine is from the reference at most, in last bits of its format."""
        return float(np.abs(self.exact - self.reference).max() * 2**Q12_20.fraction)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Figures:
    """The filter with the constants of lee1997, and with constants that give the printed numbers."""

    lee1997: Settling
    fitted: Settling


def paper_model() -> LinearModel:
    """The filter with the constants of lee1997, in both axes their own."""
    lee = facts("kumar2014")["lee1997"]
    return _model(lee["T"], lee["process"], _begun(lee["covariance"]))


def radar_model() -> LinearModel:
    """The same filter on plots of a radar, begun from two of them as in lee1997."""
    lee = facts("kumar2014")["lee1997"]
    return _model(lee["T"], lee["process"], two_point(), lee["measurement_range"])


def fitted_model() -> LinearModel:
    """The filter with the T and the first covariance that give the printed numbers."""
    fit, variances = facts("kumar2014")["fitted"], np.array(facts("kumar2014")["lee1997"]["measurement"])
    return _model(fit["T"], fit["process"] * variances, _begun(np.outer(variances, fit["covariance"])))


def _begun(covariance: Any) -> Initial | InitialRule:
    """The state of section 4.1, and the covariances of both axes: P11, P12, P22."""
    P = np.zeros((4, 4))
    for k, (p11, p12, p22) in enumerate(covariance):
        P[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[p11, p12], [p12, p22]]
    return given(facts("kumar2014")["initial"], P, at="before_first")


def _model(
    T: float,
    process: ArrayLike,
    initial: Initial | InitialRule,
    limits: ArrayLike = ((-2000, 2000), (-2000, 2000)),
) -> LinearModel:
    data = facts("kumar2014")
    return linear_model(
        np.kron(np.eye(2), [[1.0, T], [0.0, 1.0]]),
        np.kron(np.eye(2), [[1.0, 0.0]]),
        np.diag(np.kron(process, [0.0, 1.0])),
        np.diag(data["lee1997"]["measurement"]),
        initial=initial,
        state_names=("range", "range_rate", "bearing", "bearing_rate"),
        state_units=("m", "m/s", "rad", "rad/s"),
        measurement_names=("range_plot", "bearing_plot"),
        measurement_range=np.array(limits),
    )


def paper_design(model: LinearModel) -> Design:
    """Every number in Q12.20, the covariance divided by the measurement noise.

    The paper divides by the process noise. With the constants of lee1997 P11 is then 3030, which a Q12.20
    does not hold.
    """
    variances = np.diag(model.R)
    numerics = FixedSpecification(
        classes=dict.fromkeys(SIGNAL_CLASSES, Q12_20),
        scale=(1.0,) * 4,
        covariance_scale=tuple(map(float, np.repeat(variances, 2))),
    )
    return Design(name="kumar2014", model=model, algorithm=Conventional(), numerics=numerics)


def settle(model: LinearModel, constants: str, samples: int = SAMPLES) -> Settling:
    """Reference and engine on the constant measurement."""
    z = np.full((samples, 2), facts("kumar2014")["target"])
    found = paper_design(model).simulate(z)
    return Settling(
        constants=constants,
        reference=found.reference.x[:, 0],
        exact=found.exact.x[:, 0],
        saturations=found.saturations,
    )


def figures(progress: Progress = silent) -> Figures:
    """Both filters on the constant measurement."""
    progress("the constants of lee1997 in Q12.20")
    lee = settle(paper_model(), "lee1997")
    progress("constants that give the printed samples, in Q12.20")
    return Figures(lee1997=lee, fitted=settle(fitted_model(), "fitted"))


def reproduction(found: Figures) -> Reproduction:
    """The printed samples beside those of the two filters, and the settling."""
    data = facts("kumar2014")
    rows = []
    for name, sample in (("first", 0), ("tenth", 9)):
        for state, what in enumerate(("range", "rate of range", "bearing", "rate of bearing")):
            printed = data[name][state % 2]
            values = [
                f"{x[sample, state]:.9f}"
                for run in (found.lee1997, found.fitted)
                for x in (run.reference, run.exact)
            ]
            off = (found.fitted.exact[sample, state] - printed) * 2**Q12_20.fraction
            rows.append((f"{name} sample, {what}", f"{printed:.9f}", *values, f"{off:+.1f}"))
    errors = [abs(x.exact[9, 0] / data["target"] - 1) for x in (found.lee1997, found.fitted)]
    lee, fitted = (f"{100 * error:.3f} %" for error in errors)
    rows.append(("range off 20 at the tenth", f"{100 * data['settled']:.2f} %", "", lee, "", fitted, ""))
    both = (found.lee1997, found.fitted)
    rows.append(("engine off float, last bits", "", *(s for x in both for s in ("", f"{x.apart:.1f}")), ""))
    rows.append(("saturations", "", *(s for x in both for s in ("", str(x.saturations))), ""))
    return Reproduction(
        title="Kumar & Aggarwal 2014: 32 bits, Q12.20, from 10 to a constant 20",
        columns=("", "paper", "lee1997", "Q12.20", "fitted", "Q12.20", "last bits off paper"),
        rows=tuple(rows),
        notes=_notes(data),
        charts={"settling": _chart(found, data)},
    )


def _notes(data: dict[str, Any]) -> tuple[str, ...]:
    fit = data["fitted"]
    p11, p12, p22 = fit["covariance"]
    return (
        f"lee1997: T = {data['lee1997']['T']:g} s and the variances and first covariance of that paper.",
        f"fitted: T = {fit['T']:.5g} s and, over the measurement variance r, P11 = {p11:.5g}, "
        f"P12 = {p12:.4g}, P22 = {p22:.4g}; process noise {fit['process']:g} r in both axes, "
        "that of lee1997 in range.",
        "The paper prints four different numbers and none of its five constants (T, and over r the process "
        "noise, P11, P12, P22), so that others give them too.",
        "The printed rate begins below zero while the range rises: P12 must begin below zero. With P12 > 0, "
        "as lee1997 has it, it cannot.",
        "Both axes print the same digits, so both had the same constants over r; in lee1997 the process "
        "noise is 3.3e-4 r in range and 4.5e-5 r in bearing.",
        "P11 over the process noise, as the paper has it, is 3030 for lee1997, and Q12.20 ends at 2048: "
        "here P is over r.",
        "What saturates is NIS alone: an innovation of 10 is 587 standard deviations of a bearing.",
        "The printed 1.8 % is 0.18 %. Delays and areas of the paper's devices are not compared here.",
    )


def _chart(found: Figures, data: dict[str, Any]) -> Chart:
    n = np.arange(1.0, 1 + len(found.lee1997.exact))
    printed = np.array([data["first"], data["tenth"]])
    runs = (found.lee1997, found.fitted)
    panels = []
    for state, label in enumerate(("range (m)", "rate of range (m/s)")):
        lines = [
            Line(label=f"constants {run.constants}, {kind}", x=n, y=x[:, state], color=color, style=style)
            for color, run in enumerate(runs)
            for kind, x, style in (("Q12.20", run.exact, Style.DOTS), ("float", run.reference, Style.DASHED))
        ]
        at = np.array([1.0, 10.0])
        lines.append(Line(label="printed", x=at, y=printed[:, state], color=2, style=Style.RINGS))
        panels.append(Panel(label=label, lines=tuple(lines)))
    title = "kumar2014: from 10 to a constant 20, in Q12.20"
    return Chart(title=title, label="sample", panels=tuple(panels))
