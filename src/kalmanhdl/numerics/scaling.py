"""Units of the hardware: of every input, state and output of a graph."""

from dataclasses import dataclass

import numpy as np

from kalmanhdl.algorithm.memory import Kept, Kind
from kalmanhdl.model.units import Units


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scaling(Units):
    """The units of a model, and those that follow from them."""

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
