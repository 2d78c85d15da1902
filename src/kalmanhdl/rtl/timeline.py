"""Values that travel along with a step from cycle to cycle."""

from amaranth import Module, Signal, Value


class Timeline:
    """A value and its copies in later cycles; each copy is one register, made when first asked for.

    Copies are named ``<name>_c<cycle>``. With ``reset`` they are cleared by reset, as valid bits must be.
    """

    def __init__(self, m: Module, name: str, value: Value, cycle: int, *, reset: bool = False) -> None:
        self._m = m
        self._name = name
        self._cycle = cycle
        self._reset = reset
        self._copies = [value]

    @classmethod
    def computed(cls, m: Module, name: str, value: Value, shape: object, cycle: int) -> "Timeline":
        """A timeline that begins with a named signal for a value computed in a cycle."""
        signal = Signal(shape, name=f"{name}_c{cycle}")
        m.d.comb += signal.eq(value)
        return cls(m, name, signal, cycle)

    def at(self, cycle: int) -> Value:
        """The value that belongs to a step, as it stands in a cycle of the step."""
        assert cycle >= self._cycle, f"{self._name} is there in cycle {self._cycle}, not in {cycle}"
        while len(self._copies) <= cycle - self._cycle:
            last = self._copies[-1]
            name = f"{self._name}_c{self._cycle + len(self._copies)}"
            copy = Signal(last.shape(), name=name, reset_less=not self._reset)
            self._m.d.sync += copy.eq(last)
            self._copies.append(copy)
        return self._copies[cycle - self._cycle]


class Always:
    """A constant: there in every cycle, without registers."""

    def __init__(self, value: Value) -> None:
        self._value = value

    def at(self, cycle: int) -> Value:
        """The constant."""
        return self._value
