"""Values on their way through the pieces of an operator."""

from amaranth.hdl import Module, Value

from kalmanhdl.arithmetic.float_structure import Piece, weights
from kalmanhdl.rtl.stages import Stages


class Chain:
    """The pieces of one operator and the registers between them.

    Logic is built piece by piece; ``after_piece`` ends a piece.
    """

    def __init__(self, m: Module, pieces: tuple[Piece, ...], registers: int) -> None:
        self.module = m
        self.stages = Stages(m, weights(pieces), registers)
        self._count = len(pieces)
        self.piece = 0

    def after_piece(self, values: dict[str, Value]) -> dict[str, Value]:
        """What the next piece reads of the values of this one."""
        self.piece += 1
        return self.stages.before(self.piece, values)

    def skip(self, pieces: int) -> None:
        """Pieces whose registers were laid by others."""
        self.piece += pieces

    def finish(self) -> None:
        """Check that as many pieces were built as the structure tells of."""
        assert self.piece == self._count, f"{self.piece} pieces built, {self._count} planned"
