"""Names of Verilog signals, from the names and origins of the graph."""

import re
from collections import Counter

from kalmanhdl.graph.operations import Graph

# Words of Verilog-2005 that a user could call an equation or a state.
_RESERVED = frozenset(
    [
        "and",
        "assign",
        "begin",
        "buf",
        "case",
        "cell",
        "config",
        "default",
        "defparam",
        "disable",
        "edge",
        "else",
        "end",
        "endcase",
        "event",
        "for",
        "force",
        "fork",
        "function",
        "generate",
        "if",
        "initial",
        "inout",
        "input",
        "instance",
        "integer",
        "join",
        "large",
        "library",
        "localparam",
        "medium",
        "module",
        "nand",
        "negedge",
        "nor",
        "not",
        "or",
        "output",
        "parameter",
        "posedge",
        "primitive",
        "real",
        "realtime",
        "reg",
        "release",
        "repeat",
        "scalared",
        "signed",
        "small",
        "specify",
        "strength",
        "strong0",
        "strong1",
        "supply0",
        "supply1",
        "table",
        "task",
        "time",
        "tran",
        "tri",
        "unsigned",
        "use",
        "vectored",
        "wait",
        "wand",
        "weak0",
        "weak1",
        "while",
        "wire",
        "wor",
        "xnor",
        "xor",
    ]
)


def identifier(name: str) -> str:
    """A Verilog identifier that reads like the name: ``predict: P[0,1]`` becomes ``predict_P_0_1``."""
    word = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    if not word or word[0].isdigit():
        word = f"n_{word}".rstrip("_")
    return f"{word}_" if word in _RESERVED else word


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
