"""Names of Verilog signals, from the names and origins of the graph."""

import re
from collections import Counter

from kalmanhdl.graph.operations import Graph


def identifier(name: str) -> str:
    """A Verilog identifier that reads like the name: ``predict: P[0,1]`` becomes ``predict_P_0_1``."""
    word = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return word if word[:1].isalpha() else f"n_{word}".rstrip("_")


def operation_names(graph: Graph) -> tuple[str, ...]:
    """One unique identifier an operation.

    The last operation of an origin has the name of the origin; those before it, its parts, have their
    index in the graph appended.
    """
    words = [identifier(origin) for origin in graph.origins]
    left = Counter(words)
    names: list[str] = []
    for index, word in enumerate(words):
        left[word] -= 1
        names.append(word if not left[word] else f"{word}_n{index}")
    if len(set(names)) < len(names):
        names = [f"{word}_n{index}" for index, word in enumerate(words)]
    return tuple(names)
