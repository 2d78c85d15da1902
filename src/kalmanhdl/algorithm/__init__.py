"""How the model is estimated: one file an algorithm, each a pure function over arrays."""

from kalmanhdl.algorithm.conventional import Conventional
from kalmanhdl.algorithm.filter import Algorithm
from kalmanhdl.algorithm.joseph import Joseph
from kalmanhdl.algorithm.sequential import Sequential

__all__ = ["ALGORITHMS", "Algorithm", "Conventional", "Joseph", "Sequential"]

ALGORITHMS: dict[str, type[Algorithm]] = {each.kind: each for each in (Conventional, Joseph, Sequential)}
