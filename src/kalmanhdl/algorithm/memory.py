"""What a filter keeps between the steps of a track, as arrays by name."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from kalmanhdl.graph.signal import Array, Condition, select

Memory = dict[str, Array]

COUNTER = "steps"
"""The name of an array of bits that counts steps: it couples nothing that reads it."""


class Kind(Enum):
    """What an array holds, which gives its units and which of its elements are kept."""

    STATE = "state"
    """(..., n), in the units of the states."""
    COVARIANCE = "covariance"
    """(..., n, n), symmetric: the upper triangle is kept."""
    VARIANCE = "variance"
    """(..., n), in the squared units of the states."""
    FACTOR = "factor"
    """(..., n, n), unit upper triangular: what is above the diagonal is kept."""
    NUMBER = "number"
    """Any shape, without units."""


@dataclass(frozen=True, slots=True)
class Kept:
    """An array that is kept: its name, what it holds and its shape."""

    name: str
    kind: Kind
    shape: tuple[int, ...]

    def places(self) -> Iterator[tuple[int, ...]]:
        """The elements that are kept; all others follow from them."""
        least = {Kind.COVARIANCE: 0, Kind.FACTOR: 1}.get(self.kind)
        for place in np.ndindex(*self.shape):
            if least is None or place[-1] - place[-2] >= least:
                yield place

    def element(self, place: tuple[int, ...]) -> str:
        """The name of an element, such as ``P[0,1]``."""
        return f"{self.name}[{','.join(map(str, place))}]"

    def whole(self, elements: dict[tuple[int, ...], Any]) -> Array:
        """The array of kept elements by place; those not given are zero."""
        result = np.zeros(self.shape, object)
        if self.kind is Kind.FACTOR:
            result[..., range(self.shape[-1]), range(self.shape[-1])] = 1.0
        for place in self.places():
            if place in elements:
                result[place] = elements[place]
                if self.kind is Kind.COVARIANCE:
                    result[(*place[:-2], place[-1], place[-2])] = elements[place]
        return result

    def chosen(self, condition: Condition, a: Array, b: Array) -> Array:
        """a where the condition holds, else b, element by element that is kept."""
        return self.whole({place: select(condition, a[place], b[place]) for place in self.places()})
