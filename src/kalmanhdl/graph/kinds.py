"""The words by which a user counts operators."""

from collections.abc import Mapping

from kalmanhdl.graph.operations import Add, Divide, Multiply, Operation, Reciprocal, Subtract, SumOfProducts

KINDS = ("add", "subtract", "multiply", "multiply_add", "divide", "reciprocal")

ITERATIVE = ("multiply", "divide", "reciprocal")
"""Those of which there is hardware that works for several clocks on one operation."""


def kind_of(operation: Operation, counts: Mapping[str, int]) -> str | None:
    """The kind of shared operator of an operation, given how many there are of each; None for one of its own.

    Subtractions are made by adders where only these are counted.
    """
    match operation:
        case Add():
            return "add" if "add" in counts else None
        case Subtract():
            return next((kind for kind in ("subtract", "add") if kind in counts), None)
        case Multiply():
            return "multiply" if "multiply" in counts else None
        case SumOfProducts():
            return "multiply_add"
        case Divide():
            return "divide" if "divide" in counts else None
        case Reciprocal():
            return "reciprocal" if limit("reciprocal", counts) is not None else None
        case _:
            return None


def limit(kind: str, counts: Mapping[str, int]) -> int | None:
    """How many operators of a kind there are at most; of reciprocals as many as dividers, unless counted."""
    return counts.get(kind, counts.get("divide") if kind == "reciprocal" else None)
