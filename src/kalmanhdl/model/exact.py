"""Numbers of a model evaluated in decimal, far beyond a double, and rounded once."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Context, Decimal, localcontext

# What is left after any cancellation that the formulas allow.
DIGITS = 60


@contextmanager
def evaluation(smallest: float, power: int) -> Iterator[None]:
    """Decimal arithmetic in which differences of the order ``smallest``^``power`` keep DIGITS digits."""
    lost = max(0, -power * math.floor(math.log10(smallest))) if smallest > 0 else 0
    with localcontext(Context(prec=DIGITS + lost, Emin=-999_999_999, Emax=999_999_999, traps=[])):
        yield


def sine_and_cosine(angle: Decimal) -> tuple[Decimal, Decimal]:
    """Both by their series, for an angle of a few turns, to the digits of the evaluation in force."""
    sine, cosine, term, order = Decimal(0), Decimal(0), Decimal(1), 0
    while order < 2 or cosine + term != cosine:
        following = term * angle / (order + 1)
        sine, cosine = sine + following, cosine + term
        term, order = -following * angle / (order + 2), order + 2
    return sine, cosine
