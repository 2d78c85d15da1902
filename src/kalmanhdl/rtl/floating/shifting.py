"""Shifts of significands, a level a piece."""

from collections.abc import Sequence

from amaranth.hdl import Cat, Const, Mux, Value

from kalmanhdl.arithmetic.float_structure import levels
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.stages import named


def shifted_right(chain: Chain, state: dict[str, Value], count: int, width: int) -> dict[str, Value]:
    """``value`` shifted right by ``amount``, its lowest ``width`` bits: what is above them is zero then.

    ``sticky`` tells of ones that fell out.
    """
    state = dict(state)
    for level in reversed(range(count)):
        places, value, moves = 1 << level, state["value"], state["amount"][level]
        fallen = value[:places].any() & moves
        moved = Cat(value[places:], Const(0, min(places, len(value))))
        value = Mux(moves, moved, value)[: len(value)]
        state["sticky"] = state["sticky"] | fallen
        kept = min(width + places - 1, len(value))
        state["value"] = named(chain.module, f"right_{chain.piece}", value[:kept])
        state = chain.after_piece(state)
    del state["amount"]
    return state


def normalised(
    chain: Chain, state: dict[str, Value], count: int, names: Sequence[str], limited: bool = False
) -> dict[str, Value]:
    """Each value of ``names`` shifted left until its top bit is one, ``<name>_shift`` telling how far.

    Where ``limited`` it is shifted by ``<name>_room`` at most.
    """
    state = dict(state)
    for name in names:
        if limited:
            room = state[f"{name}_room"]
            state[f"{name}_free"] = room[count:].any()
            state[f"{name}_room"] = Cat(room, Const(0, count))[:count]
        state[f"{name}_shift"] = Const(0, 0)
    for level in reversed(range(count)):
        for name in names:
            places, value = 1 << level, state[name]
            empty = named(chain.module, f"{name}_empty_{level}", ~value[-places:].any())
            moves = empty
            if limited:
                room = state[f"{name}_room"]
                moves = named(
                    chain.module, f"{name}_moves_{level}", empty & (state[f"{name}_free"] | room[level])
                )
                state[f"{name}_free"] = state[f"{name}_free"] | room[level] & ~empty
                state[f"{name}_room"] = room[:level]
            moved = Cat(Const(0, places), value)[: len(value)]
            value = Mux(moves, moved, value)[: len(value)]
            state[name] = named(chain.module, f"{name}_left_{level}", value)
            state[f"{name}_shift"] = Cat(moves, state[f"{name}_shift"])
        state = chain.after_piece(state)
    for name in names:
        for key in ("room", "free"):
            state.pop(f"{name}_{key}", None)
    return state


def denormalised(chain: Chain, form: Float, state: dict[str, Value]) -> dict[str, Value]:
    """A result whose exponent is below 1 shifted right until it is 1, where subnormals count.

    ``significand`` with ``guard`` and ``sticky`` below it, ``below`` the exponent less one, signed.
    """
    if not form.subnormals:
        return state
    state = dict(state)
    below, most = state["below"], form.mantissa + 2
    count = levels(most)
    less = named(chain.module, "less", Mux(below[-1], -below.as_signed(), 0)[: len(below)])
    state["amount"] = less[:count] | less[count:].any().replicate(count)
    state["below"] = below & ~below[-1].replicate(len(below))
    state["value"] = Cat(state.pop("guard"), state.pop("significand"))
    state = shifted_right(chain, chain.after_piece(state), count, most)
    value = state.pop("value")
    return state | {"significand": value[1:], "guard": value[0]}
