"""How proofs are set up: a component's own signals for invariants, and the proof of what it asserts."""

from dataclasses import dataclass

from amaranth.hdl import Fragment, Module, Signal
from amaranth.lib.wiring import Component

from kalmanhdl.rtl.verilog import to_rtlil
from kalmanhdl.toolchain.formal import Proof, prove


def opened(component: Component) -> tuple[Fragment, dict[str, Signal]]:
    """The hardware of a component, to be used in its place, and the signals that it drives, by name."""
    fragment = Fragment.get(component, None)
    driven = {
        signal.name: signal
        for statements in fragment.statements.values()
        for signal in statements._lhs_signals()
    }
    return fragment, driven


def proof(component: Component, clocks: int = 1, *, induction: bool = False) -> Proof:
    """The proof of all that a component asserts."""
    return prove(to_rtlil(component, "top"), "top", clocks, induction=induction)


@dataclass
class Sequence:
    """A reference that numbers tokens: as many were sent and received as its registers say, modulo 16."""

    sent: Signal
    received: Signal

    @classmethod
    def counting(cls, m: Module, send: object, receive: object) -> "Sequence":
        """Count two events."""
        found = cls(Signal(4, name="sent"), Signal(4, name="received"))
        m.d.sync += [found.sent.eq(found.sent + send), found.received.eq(found.received + receive)]
        return found

    @property
    def inside(self):
        """How many are on the way."""
        return (self.sent - self.received)[:4]
