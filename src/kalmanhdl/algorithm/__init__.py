"""How the model is estimated: one file an algorithm, each a pure function over arrays."""

from kalmanhdl.algorithm.bierman_thornton import BiermanThornton
from kalmanhdl.algorithm.conventional import Conventional
from kalmanhdl.algorithm.converted import Converted
from kalmanhdl.algorithm.extended import Extended
from kalmanhdl.algorithm.filter import Algorithm
from kalmanhdl.algorithm.interacting import Interacting
from kalmanhdl.algorithm.joseph import Joseph
from kalmanhdl.algorithm.scheduled import Scheduled
from kalmanhdl.algorithm.sequential import Sequential
from kalmanhdl.algorithm.taylor import Taylor

__all__ = [
    "ALGORITHMS",
    "LINEAR",
    "Algorithm",
    "BiermanThornton",
    "Conventional",
    "Converted",
    "Extended",
    "Interacting",
    "Joseph",
    "Scheduled",
    "Sequential",
    "Taylor",
]

_LINEAR: tuple[type[Algorithm], ...] = (
    *(BiermanThornton, Conventional, Joseph, Sequential),
    *(Scheduled, Taylor),
)
_OTHERS: tuple[type[Algorithm], ...] = (Converted, Extended, Interacting)

LINEAR = tuple(each.kind for each in _LINEAR)
"""The algorithms for linear models, by their words in a design file."""
ALGORITHMS = {each.kind: each for each in (*_LINEAR, *_OTHERS)}
"""Every algorithm by its word in a design file."""
