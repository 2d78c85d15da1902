"""Linear algebra over arrays whose elements are floats, arrays over tracks, or Signals."""

from collections.abc import Iterable

import numpy as np

from kalmanhdl.graph.signal import Array, Scalar, is_zero


def symmetric(matrix: Array) -> Array:
    """The matrix whose lower triangle is its upper one: n (n + 1) / 2 different elements."""
    result = matrix.copy()
    for i, j in zip(*np.tril_indices(len(matrix), -1), strict=True):
        result[i, j] = result[j, i]
    return result


def vector(elements: Iterable[Scalar]) -> Array:
    """An array of one dimension, also where the elements are arrays themselves."""
    listed = list(elements)
    result = np.empty(len(listed), object)
    for place, element in enumerate(listed):
        result[place] = element
    return result


def times(elements: Array, factor: Scalar) -> Array:
    """Every element of an array times one factor, which may itself be an array over tracks."""
    result = np.empty(elements.shape, object)
    for place in np.ndindex(*elements.shape):
        result[place] = elements[place] * factor
    return result


def quotient(a: Scalar, b: Scalar) -> Scalar:
    """a / b, which is zero for a structural zero a, whatever b is."""
    return 0.0 if is_zero(a) else a / b


def inverse(S: Array) -> Array:
    """The inverse of a symmetric positive definite matrix from S = L D L', m reciprocals.

    S is (m, m). Zeros of S stay zeros of L, so that decoupled blocks are inverted apart.
    """
    return _from_factors(*_factors(S))


def pivot_reciprocals(S: Array) -> Array:
    """1 / D of S = L D L', whose product is 1 / det S. Shape (m,)."""
    return _factors(S)[1]


def _factors(S: Array) -> tuple[Array, Array]:
    """L (m, m) and 1 / D (m,) of S = L D L'."""
    m = len(S)
    L, reciprocal = np.eye(m).astype(object), np.empty(m, object)
    remaining = S.copy()
    for j in range(m):
        reciprocal[j] = 1.0 / remaining[j, j]
        for i in range(j + 1, m):
            L[i, j] = remaining[i, j] * reciprocal[j]
        for i in range(j + 1, m):
            for k in range(i, m):
                remaining[i, k] = remaining[i, k] - L[i, j] * remaining[j, k]
                remaining[k, i] = remaining[i, k]
    return L, reciprocal


def _from_factors(L: Array, reciprocal: Array) -> Array:
    """X with L D L' X = I, from the last row up: D L' X = L^-1, whose upper triangle is zero but for ones."""
    m = len(L)
    X = np.zeros((m, m), object)
    for j in range(m - 1, -1, -1):
        for i in range(j, -1, -1):
            total = reciprocal[j] if i == j else 0.0
            for k in range(i + 1, m):
                total = total - L[k, i] * X[k, j]
            X[i, j] = X[j, i] = total
    return X


def blocks(S: Array) -> list[list[int]]:
    """The index sets of the decoupled blocks of a symmetric matrix, each sorted, in order."""
    remaining, found = set(range(len(S))), []
    while remaining:
        block, stack = set(), [min(remaining)]
        while stack:
            i = stack.pop()
            if i not in block:
                block.add(i)
                stack.extend(j for j in remaining if not is_zero(S[i, j]))
        remaining -= block
        found.append(sorted(block))
    return found
