"""The flag that tells that a track's numbers left their formats, kept until the track starts anew."""

from collections.abc import Iterable

from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.operations import Flag, StateFlag
from kalmanhdl.graph.simplify import TERM

NAME = "saturated"
Watched = tuple[int, bool, bool]
"""A flag, and whether it matters in a step that initialises, and in others."""


def sticky(builder: Builder, flags: Iterable[Watched]) -> int:
    """The value of the flag: one of ``flags`` in this step, or in one since ``initialise``.

    A graph without that command never forgets.
    """
    kept = builder.intern(StateFlag(NAME))
    builder.name(kept, NAME)
    before = len(builder.operations)
    found = list(flags)
    parts = [flag for flag, starting, running in found if starting and running]
    starting = [flag for flag, starts, running in found if starts and not running]
    running = [kept, *(flag for flag, starts, runs in found if runs and not starts)]
    if Flag("initialise") in builder.operations:
        initialise = builder.intern(Flag("initialise"))
        if starting:
            parts.append(builder.both(initialise, _any(builder, starting)))
        parts.append(builder.both(builder.opposite(initialise), _any(builder, running)))
    else:
        parts += running
    result = _any(builder, parts)
    for index in range(before, len(builder.operations)):
        builder.name(index, "posterior: saturated" if index == result else "posterior: saturated" + TERM)
    return result


def _any(builder: Builder, flags: list[int]) -> int:
    while len(flags) > 1:
        pairs = [flags[k : k + 2] for k in range(0, len(flags), 2)]
        flags = [builder.either(*pair) if len(pair) == 2 else pair[0] for pair in pairs]
    return flags[0]
