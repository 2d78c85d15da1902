"""How the model is estimated: one file an algorithm, each a pure function over arrays."""

from kalmanhdl.algorithm.conventional import Conventional
from kalmanhdl.algorithm.filter import Algorithm
from kalmanhdl.algorithm.joseph import Joseph

__all__ = ["ALGORITHMS", "Algorithm", "Conventional", "Joseph"]

ALGORITHMS: dict[str, type[Algorithm]] = {each.kind: each for each in (Conventional, Joseph)}
