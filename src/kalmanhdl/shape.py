"""The shape of a programmable datapath: all that its hardware is made of, whatever filter it runs."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

from kalmanhdl.numerics.choices import MAX_INDEX_BITS
from kalmanhdl.validation import InvalidValueError, integer, nearest, shown

_LIMITS = MappingProxyType(
    {
        "rows": (16, 4096),
        "words": (16, 1024),
        "operand_width": (4, 36),
        "word_width": (12, 72),
        "states": (1, 64),
        "measurements": (1, 64),
        "controls": (0, 64),
    }
)
_POWERS = ("rows", "words")
_COUNTS = MappingProxyType({"multiply": (1, 16), "add": (1, 16), "reciprocal": (1, 1)})
_ADDER_PORTS, _MULTIPLIER_PORTS = ("a", "b", "c"), ("a", "b")


@dataclass(frozen=True)
class Shape:
    """How many units, how large their memories, how wide their numbers.

    ``units`` counts multipliers, and adders, which subtract and select as well; there is one reciprocal unit,
    exact or with a table of 2**``reciprocal_table`` entries.
    ``rows`` of control are in the store, one a clock of a step. Before each port of a unit there is a file
    of so many ``words``. Multipliers take operands of ``operand_width`` bits, everything else words of
    ``word_width`` bits, both signed; one operand of a multiplier, and the ports of the streams, have a bit
    more, so that they hold unsigned numbers of ``operand_width`` bits as well. ``states``, ``measurements``
    and ``controls`` say how many ports there are.

    Raises DesignError for numbers that cannot be.
    """

    units: Mapping[str, int] = field(default_factory=dict)
    rows: int = 256
    words: int = 128
    operand_width: int = 18
    word_width: int = 48
    states: int = 4
    measurements: int = 2
    controls: int = 0
    reciprocal_table: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", _counted(self.units))
        for key, limits in _LIMITS.items():
            object.__setattr__(self, key, integer("architecture", key, getattr(self, key), *limits))
        for key in _POWERS:
            value = getattr(self, key)
            if value & (value - 1):
                low, high = _LIMITS[key]
                problem = f" = {value}: a power of two from {low} to {high}"
                raise InvalidValueError("architecture", key, problem)
        if self.reciprocal_table is not None:
            bits = integer("architecture", "reciprocal_table", self.reciprocal_table, 1, MAX_INDEX_BITS)
            object.__setattr__(self, "reciprocal_table", bits)
        product = 2 * self.operand_width + 1
        if self.word_width < product:
            problem = f" = {self.word_width}: a product has {product} bits: use as many or more"
            raise InvalidValueError("architecture", "word_width", problem)

    @cached_property
    def unit_names(self) -> tuple[str, ...]:
        """The units by name, in the order in which a file counts them as sources."""
        multipliers = (f"multiply_{k}" for k in range(self.units["multiply"]))
        return (*multipliers, *(f"add_{k}" for k in range(self.units["add"])), "reciprocal", "input")

    @cached_property
    def rounding_units(self) -> tuple[str, ...]:
        """The units with a stage that rounds behind them."""
        return tuple(unit for unit in self.unit_names if unit not in ("reciprocal", "input"))

    @cached_property
    def files(self) -> tuple[str, ...]:
        """The files of operands, each called by its unit and its port."""
        return tuple(self._files())

    def _files(self) -> Iterator[str]:
        for unit in self.unit_names:
            yield from (f"{unit}_{port}" for port in self.ports(unit))

    def ports(self, unit: str) -> tuple[str, ...]:
        """The ports of a unit."""
        if unit.startswith("add"):
            return _ADDER_PORTS
        if unit.startswith("multiply"):
            return _MULTIPLIER_PORTS
        return ("a",) if unit == "reciprocal" else ()

    def file_width(self, file: str) -> int:
        """Bits of the words of a file; one bit is a flag, more are a signed number."""
        unit, _, port = file.rpartition("_")
        if port == "c":
            return 1
        if unit.startswith("add"):
            return self.word_width
        return self.operand_width if port == "b" else self.number_width

    @property
    def number_width(self) -> int:
        """Bits of the numbers of the streams, signed."""
        return self.operand_width + 1

    @property
    def inputs(self) -> tuple[str, ...]:
        """What comes with a step, by the graph's names, in the order in which the hardware counts it."""
        present = (f"valid[{j}]" for j in range(self.measurements))
        numbers = (f"z[{j}]" for j in range(self.measurements))
        controls = (f"u[{k}]" for k in range(self.controls))
        return (*numbers, *controls, *present, "initialise")

    @property
    def outputs(self) -> tuple[str, ...]:
        """What a step puts out beside ``saturated``, by the graph's names, in the order of the hardware."""
        means = (f"x[{i}]" for i in range(self.states))
        variances = (f"P[{i},{i}]" for i in range(self.states))
        return (*means, *variances, *(f"innovation[{j}]" for j in range(self.measurements)), "nis")


def _counted(counts: object) -> Mapping[str, int]:
    """How many units of each kind, one where nothing is said."""
    if not isinstance(counts, Mapping):
        problem = f" = {shown(counts)}: write a count for each kind, such as {{ multiply = 2, add = 2 }}"
        raise InvalidValueError("architecture", "units", problem)
    found = dict.fromkeys(_COUNTS, 1)
    for kind, count in counts.items():
        if not isinstance(kind, str) or kind not in _COUNTS:
            problem = f" is no unit of a programmable datapath: {nearest(str(kind), _COUNTS)}"
            raise InvalidValueError("architecture.units", str(kind), problem)
        found[kind] = integer("architecture.units", kind, count, *_COUNTS[kind])
    return found
