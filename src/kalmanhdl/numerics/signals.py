"""Which signal class an operation belongs to, by its origin."""

import re
from dataclasses import dataclass

from kalmanhdl.graph.simplify import TERM

_ORIGIN = re.compile(r"(?:(?P<stage>\w+): )?(?P<base>\w+)\[(?P<place>[\d,]+)\]\Z")
_CLASSES = {
    "x": "state",
    "P": "covariance",
    "U": "covariance",
    "D": "covariance",
    "z": "measurement",
    "u": "control",
    "y": "innovation",
    "innovation": "innovation",
    "S": "innovation_covariance",
    "PHt": "covariance",
    "Si": "reciprocal",
    "K": "gain",
    "Kv": "gain",
    "steps": "bit",
    "c": "constant",
}
# The belief after an update has its format as a state of the filter, after the command is known.
_ROUNDED_AS_STATE = {
    ("update", "x"),
    ("update", "P"),
    ("update", "U"),
    ("update", "D"),
    ("initialise", "x"),
    ("posterior", "x"),
    ("posterior", "P"),
    ("posterior", "U"),
    ("posterior", "D"),
}
_VARIANCES = ("P", "S", "D")


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalName:
    """A signal as the user knows it: ``P[0,1]`` of the class ``covariance``."""

    name: str
    signal_class: str
    # A variance or a reciprocal: never negative.
    unsigned: bool
    # Its value is brought into its format wherever it is computed, not only where it is multiplied.
    own_format: bool


def signal_of(origin: str) -> SignalName:
    """The signal that an origin such as ``predict: P[0,1]`` names; a term belongs to what it is a term of."""
    term = origin.endswith(TERM)
    match = _ORIGIN.match(origin.removesuffix(TERM))
    if match is None:
        nis = origin.startswith("output: nis")
        return SignalName(
            name=origin,
            signal_class="nis" if nis else "product",
            unsigned=nis and not term,
            own_format=not term,
        )
    stage, base, place = match["stage"], match["base"], match["place"]
    indices = place.split(",")
    variance = base in _VARIANCES and len(set(indices)) == 1 and not term
    return SignalName(
        name=f"{base}[{place}]",
        signal_class="product" if term else _CLASSES.get(base, "product"),
        unsigned=variance,
        own_format=not term and (stage, base) not in _ROUNDED_AS_STATE,
    )
