"""What a program of the engine is: its C, and the arrays that it takes and gives."""

from dataclasses import dataclass, field

from kalmanhdl.simulate.expression import Kind, signed_bits

# The narrowest arrays hold their integers as these types of the C; wider integers have arrays of limbs.
ROWS = {
    "int16": (-(1 << 15), (1 << 15) - 1, Kind.INT32),
    "uint16": (0, (1 << 16) - 1, Kind.INT32),
    "int32": (-(1 << 31), (1 << 31) - 1, Kind.INT32),
    "uint32": (0, (1 << 32) - 1, Kind.INT64),
    "int64": (-(1 << 63), (1 << 63) - 1, Kind.INT64),
}

# The flag of a step that starts a track.
INITIALISE = "initialise"


@dataclass(frozen=True, slots=True)
class FloatKind:
    """A C type of floating-point numbers, whose raw integers have ``bits``; see ``float.h``."""

    c_type: str
    bits: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """A value that enters or leaves a step, in an array.

    ``index`` is the operation whose value it is, ``low`` and ``high`` the bounds of its raw integers. In
    the C it is the member ``x<index>`` of a structure, of type ``kind``. The array is of type ``row``:
    NumPy's narrowest for these bounds, uint8 for flags, uint64 of so many ``limbs`` if no type holds them;
    each of its integers has ``size`` bytes.
    """

    name: str
    index: int
    kind: Kind | FloatKind
    low: int
    high: int
    flag: bool

    row: str = field(init=False)
    limbs: int = field(init=False)
    size: int = field(init=False)

    def __post_init__(self) -> None:
        # Runs of few steps ask for these more often than a property is worth.
        row = self._row()
        fits = self.flag or row in ROWS or (isinstance(self.kind, FloatKind) and self.kind.bits <= 64)
        limbs = 0 if fits else -(-signed_bits(self.low, self.high) // 64)
        size = int(row.lstrip("uint")) // 8 * max(limbs, 1)
        for name, value in (("row", row), ("limbs", limbs), ("size", size)):
            object.__setattr__(self, name, value)

    def _row(self) -> str:
        if self.flag:
            return "uint8"
        if isinstance(self.kind, FloatKind):
            return next((f"uint{size}" for size in (16, 32) if self.kind.bits <= size), "uint64")
        fits = (name for name, (low, high, _) in ROWS.items() if low <= self.low and self.high <= high)
        return next(fits, "uint64")

    @property
    def narrows(self) -> bool:
        """Whether an input's array may as well hold integers of 64 bits."""
        return not (self.flag or self.limbs or isinstance(self.kind, FloatKind))


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """The C of one graph, and the order in which its arrays are handed over.

    ``counted`` are the operations that can leave their format, ``violations`` the values of the
    graph's violations, counted after those and only where they matter; ``watched`` are those whose
    extremes are kept. Without ``text`` there is no C for numbers of this kind.
    """

    name: str
    text: str
    bits: int
    inputs: tuple[Port, ...]
    flags: tuple[Port, ...]
    states: tuple[Port, ...]
    outputs: tuple[Port, ...]
    counted: tuple[int, ...]
    violations: tuple[int, ...]
    watched: tuple[Port, ...]
