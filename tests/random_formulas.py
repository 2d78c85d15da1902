"""Formulas drawn at random: strings that are smooth wherever all variables are from 0.5 to 2."""

import numpy as np

_SMOOTH = ("sin({})", "cos({})", "exp(-0.3*({}))", "sqrt(3 + ({})^2)", "1/(2 + ({})^2)", "wrap(0.1*sin({}))")
_PAIRS = (
    "({}) + ({})",
    "({}) - ({})",
    "({})*({})",
    "({})/(2 + ({})^2)",
    "hypot({}, 1 + ({})^2)",
    "atan2({}, 2 + ({})^2)",
)


def random_formula(random: np.random.Generator, names: list[str], depth: int = 3) -> str:
    """A formula in some of the names."""
    if depth == 0 or random.random() < 0.15:
        if random.random() < 0.25:
            return f"{random.uniform(0.2, 2.0):.3f}"
        return str(random.choice(names))
    if random.random() < 0.4:
        return str(random.choice(_SMOOTH)).format(random_formula(random, names, depth - 1))
    pair = str(random.choice(_PAIRS))
    return pair.format(random_formula(random, names, depth - 1), random_formula(random, names, depth - 1))
