"""How the model is estimated: one file an algorithm, each a pure function over arrays."""

from kalmanhdl.algorithm.conventional import conventional
from kalmanhdl.algorithm.joseph import joseph
from kalmanhdl.algorithm.step import Update

ALGORITHMS: dict[str, Update] = {"conventional": conventional, "joseph": joseph}
