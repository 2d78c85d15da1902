"""An operator: how long it takes on a device, and where registers can cut it.

Delays are whole picoseconds, so that sums compare exactly and schedules do not depend on the order of
additions.
"""

from dataclasses import dataclass
from functools import lru_cache

from kalmanhdl.arithmetic.pipelining import register_places


@dataclass(frozen=True, slots=True, kw_only=True)
class Operator:
    """The hardware of one operation: indivisible ``pieces`` of logic in order, in picoseconds.

    A pipeline register can stand between any two pieces; ``weights`` are the delays by which the
    hardware decides where (none: the pieces themselves). ``blocks`` counts multiplier blocks.

    A shared operator chooses among operands before the first piece, in stages of ``fetch`` picoseconds that
    each end in registers; one that is ``kept`` ends in a register behind the last piece. It holds ``asked``
    registers at least.

    Where its pieces took more than the device's table says, ``derate`` times as much, it gets the registers
    that this needs, and at the most one behind its last piece: then a piece that alone is too long has its
    stage for itself.
    """

    kind: str
    pieces: tuple[int, ...]
    weights: tuple[float, ...] = ()
    blocks: int = 0
    fetch: tuple[int, ...] = ()
    kept: bool = False
    asked: int = 0
    derate: float = 1.0

    @property
    def delay(self) -> int:
        """Picoseconds from operands to value without registers inside, derated."""
        return round(sum(self.pieces) * self.derate)

    @property
    def capacity(self) -> int:
        """The number of registers that it can hold."""
        return len(self.pieces) - 1 + self._around + (self.derate > 1 and not self.kept)

    @property
    def fewest(self) -> int:
        """The number of registers that it holds at least."""
        return max(self.asked, self._around)

    @property
    def _around(self) -> int:
        """The registers before and behind all pieces."""
        return len(self.fetch) + self.kept

    def stages(self, registers: int) -> tuple[int, ...]:
        """The delays of its stages when it holds so many registers, ``fewest`` at least."""
        return (*self.fetch, *self._inside(registers - self._around), *((0,) * self.kept))

    def _inside(self, registers: int) -> tuple[int, ...]:
        """The pieces with so many registers between them."""
        return _stages(self.pieces, self.weights or self.pieces, registers)

    def derated(self, registers: int) -> tuple[int, ...]:
        """The delays of its stages as a placement found them; the choice of operands as it is."""
        delays = self.stages(registers)
        if self.derate == 1:
            return delays
        kept = len(self.fetch)
        return (*delays[:kept], *(round(delay * self.derate) for delay in delays[kept:]))

    def needed(self, budget: int, tail: int) -> int:
        """The fewest registers with which its stages fit into a budget, the last followed by other logic.

        As many as it can hold where a derated piece is longer than the budget. ``tail`` is that of the logic.
        """
        return next(
            (k for k in range(self.fewest, self.capacity) if self._fits(self.derated(k), budget, tail)),
            self.capacity,
        )

    @staticmethod
    def _fits(delays: tuple[int, ...], budget: int, tail: int) -> bool:
        return max(delays) <= budget and delays[-1] + tail <= budget

    def shortest_stage(self, tail: int) -> int:
        """The least budget that it fits into with any number of registers, by the table."""
        # By the table, so that a factor does not make the clock longer that is expected.
        least = sum(self.fetch) + sum(self.pieces) + tail
        floor = max(*self.pieces, *self.fetch, tail)
        # From the most registers on, which as a rule reach at once what no number of them can fall below.
        for registers in range(self.capacity, self.fewest - 1, -1):
            delays = self.stages(registers)
            least = min(least, max(*delays, delays[-1] + tail))
            if least == floor:
                break
        return least


@dataclass(frozen=True, slots=True, kw_only=True)
class MultiplyAdd(Operator):
    """A sum of so many ``pairs``: a product, the ``add`` that follows each, and what ``ends`` their sum.

    The ``pieces`` are those of the product. Behind every sum stands its register. What is in the end chosen
    for a bus comes ``leaving`` later.
    """

    add: int
    ends: int
    leaving: int
    pairs: int = 1

    @property
    def delay(self) -> int:
        """Picoseconds from the operands of one product to the value."""
        return round((sum(self.pieces) + self.add + self.ends + self.leaving) * self.derate)

    @property
    def capacity(self) -> int:
        """All that ``MultiplyAddRegisters`` can name."""
        return self.fewest + len(self.pieces) + 1

    @property
    def fewest(self) -> int:
        """Those of the operands, and those of the sum so far after each product."""
        return len(self.fetch) + self.pairs

    def stages(self, registers: int) -> tuple[int, ...]:
        """The delays of its stages: the sum's once for each product."""
        held = multiply_add_registers(registers - self.fewest, len(self.pieces))
        *first, last = self._inside(held.inside)
        front = (*first, last, self.add) if held.apart else (*first, last + self.add)
        sums = (self.add,) * (self.pairs - 1)
        back = (self.ends, self.leaving) if held.kept else (self.ends + self.leaving,)
        return (*self.fetch, *front, *sums, *back)

    def shortest_stage(self, tail: int) -> int:
        """The least budget that it fits into with any number of registers, by the table."""
        stages = self.stages(self.capacity)
        return max(*stages, stages[-1] + tail)


@dataclass(frozen=True, slots=True, kw_only=True)
class MultiplyAddRegisters:
    """Where a multiply-add unit holds registers besides those of operands and sum.

    ``apart``: between product and sum; ``inside`` the product; ``kept``: behind the quantisation.
    """

    apart: bool
    inside: int
    kept: bool


def multiply_add_registers(count: int, pieces: int) -> MultiplyAddRegisters:
    """The places of so many registers, of a product of so many pieces: between product and sum first."""
    apart = count > 0
    inside = min(count - apart, pieces - 1)
    return MultiplyAddRegisters(apart=apart, inside=inside, kept=count - apart - inside > 0)


def picoseconds(nanoseconds: float) -> int:
    """Whole picoseconds."""
    return round(1000 * nanoseconds)


@lru_cache(maxsize=4096)
def _stages(pieces: tuple[int, ...], weights: tuple[float, ...], registers: int) -> tuple[int, ...]:
    loads = [0]
    for count, piece in zip(register_places(weights, registers), (*pieces, 0), strict=True):
        loads += [0] * count
        loads[-1] += piece
    return tuple(loads)


def kind_of(operation: object) -> str:
    """The word for the hardware of an operation."""
    name = type(operation).__name__
    return "state_flag" if name == "StateFlag" else name.lower()
