from kalmanhdl.numerics.typed import TypedGraph


def balanced(typed: TypedGraph) -> TypedGraph:
    return typed
