"""Units of the hardware: a model written in other units of state, measurement and covariance."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.memory import Kept, Kind
from kalmanhdl.model.state_space import LinearModel

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scaling:
    """The real value of one unit: x = state * x', z = measurement * z', u = control * u'.

    The covariance of every decoupled component is divided by a number as well, which leaves the gain
    alone: P[i,j] = state[i] state[j] covariance[i] P'[i,j]. It is the general form of the
    normalisation by sigma^2 of lee1997, eq. 14. Shapes: (n,), (m,), (p,), (n,).
    """

    state: Array
    measurement: Array
    control: Array
    covariance: Array

    def covariances(self) -> Array:
        """The real value of one unit of every entry of P. Shape (n, n)."""
        return np.asarray(np.outer(self.state, self.state) * self.covariance[:, None])

    def units(self, memory: tuple[Kept, ...]) -> dict[str, float]:
        """The real value of one unit of every input, state and output of a graph, by name."""
        covariances = self.covariances()
        units = {f"z[{j}]": float(e) for j, e in enumerate(self.measurement)}
        units |= {f"innovation[{j}]": float(e) for j, e in enumerate(self.measurement)}
        units |= {f"u[{k}]": float(g) for k, g in enumerate(self.control)}
        units |= {f"x[{i}]": float(d) for i, d in enumerate(self.state)}
        units |= {f"P[{i},{i}]": float(unit) for i, unit in enumerate(np.diag(covariances))}
        of_kind = {
            Kind.STATE: self.state,
            Kind.COVARIANCE: covariances,
            Kind.VARIANCE: np.diag(covariances),
            Kind.FACTOR: np.divide.outer(self.state, self.state),
        }
        for kept in memory:
            all_of_it = np.broadcast_to(of_kind.get(kept.kind, np.ones(())), kept.shape)
            units |= {kept.element(place): float(all_of_it[place]) for place in kept.places()}
        return units | {"nis": 1.0}


def scaled(model: LinearModel, scaling: Scaling) -> LinearModel:
    """The same model in the units of a scaling."""
    d, e, g = scaling.state, scaling.measurement, scaling.control
    c = scaling.covariance
    c_measured = measurement_covariance_unit(model, scaling)
    spread = np.sqrt(np.outer(c, c))
    # The square root of a square need not be exact; on the diagonal blocks the unit is c itself.
    spread[np.equal.outer(c, c)] = np.broadcast_to(c, spread.shape)[np.equal.outer(c, c)]
    spread_measured = np.where(
        np.equal.outer(c_measured, c_measured), c_measured, np.sqrt(np.outer(c_measured, c_measured))
    )
    initial = model.initial
    return replace(
        model,
        F=model.F * d / d[:, None],
        H=model.H * d / e[:, None],
        Q=model.Q / np.outer(d, d) / spread,
        R=model.R / np.outer(e, e) / spread_measured,
        B=model.B * g / d[:, None],
        offset=model.offset / d,
        measurement_offset=model.measurement_offset / e,
        initial=replace(
            initial,
            x=initial.x / d,
            from_measurement=initial.from_measurement * e / d[:, None],
            from_state=initial.from_state * d / d[:, None],
            P=initial.P / np.outer(d, d) / spread,
            from_control=None if initial.from_control is None else initial.from_control * g / d[:, None],
        ),
        measurement_range=None if model.measurement_range is None else model.measurement_range / e[:, None],
        nis_weight=None if np.all(c_measured == 1.0) else 1.0 / c_measured,
    )


def measurement_covariance_unit(model: LinearModel, scaling: Scaling) -> Array:
    """The number by which the covariance of each measurement's component is divided. Shape (m,)."""
    seen = [np.flatnonzero(row) for row in model.H]
    return np.array([scaling.covariance[row[0]] if len(row) else 1.0 for row in seen])
