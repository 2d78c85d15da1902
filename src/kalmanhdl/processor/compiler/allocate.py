"""Where every matrix of a section stands in the data store."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.compiler.graph import (
    Computed,
    Constant,
    Given,
    Held,
    Put,
    Read,
    Section,
    sources_of,
)
from kalmanhdl.processor.compiler.schedule import accumulated_into
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import VECTORS, Opcode

_NUMBERS = {Opcode.RECIP, Opcode.DET_33, Opcode.PICK, Opcode.FUNC}
"""Instructions that write the first element alone, where they are not done in place."""

_ROWS = {*VECTORS, *_NUMBERS}
"""Instructions that leave elements of their destination as they were."""

_OF_ELEMENTS = {*_NUMBERS, Opcode.PLACE}
"""Instructions that read elements alone."""

_SCRATCH = "_"


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """Names of matrices by address: the lasting ones, then scratch for numbers, for vectors, for matrices.

    ``of[section][node]`` is the name of each node's place; nothing stands in ``spare`` before the sections.
    """

    names: tuple[str, ...]
    spare: str
    of: Mapping[str, Mapping[int, str]]


def allocate(filter_: Traced, sections: Sequence[Section], core: Core, *, turns: bool) -> Places:
    """A place for every node of scheduled sections: scratch is used again once nobody needs what is in it.

    ``turns``: a matrix is needed before them.

    Raises ProgramError where the data store is too small.
    """
    given = dict.fromkeys(each.name for one in sections for each in one.nodes if isinstance(each, Given))
    held = dict.fromkeys(name for one in sections for name in one.held)
    lasting = [*held, *given, *filter_.constants]
    scratch: dict[str, list[str]] = {"s": [], "v": [], "t": []}
    of = {each.name: _of_section(each, filter_.vectors, scratch) for each in sections}
    if turns and not scratch["t"]:
        scratch["t"].append(f"{_SCRATCH}t0")
    names = (*lasting, *(name for kind in ("s", "v", "t") for name in scratch[kind]))
    if len(names) > core.matrices:
        raise ProgramError(
            f"the filter needs {len(names)} matrices and the data store has {core.matrices}: enlarge it"
        )
    return Places(names=names, spare=f"{_SCRATCH}t0", of=of)


def _of_section(section: Section, vectors: Collection[str], scratch: dict[str, list[str]]) -> dict[int, str]:
    last = _last_uses(section)
    results = {node: name for name, node in section.held.items()}
    ends = accumulated_into(section)
    places: dict[int, str] = {}
    free = {kind: list(names) for kind, names in scratch.items()}
    for index, node in enumerate(section.nodes):
        match node:
            case Constant(name) | Held(name) | Given(name, _) | Read(name, _):
                places[index] = name
            case Computed() if node.in_place:
                places[index] = places[node.sources[-1]]
                _release(index, set(node.sources[:-1]) - {node.sources[-1]}, last, places, free)
            case Computed():
                _release(index, set(node.sources), last, places, free)
                direct = _direct(section, index, results.get(ends[index]), vectors, last)
                places[index] = direct or _taken(section, index, scratch, free)
            case Put(source, _):
                _release(index, {source}, last, places, free)
    return places


def _release(
    index: int,
    sources: set[int],
    last: Mapping[int, int],
    places: Mapping[int, str],
    free: Mapping[str, list[str]],
) -> None:
    """The scratch of the sources that nobody needs after a node is free."""
    for source in sorted(sources):
        if last[source] == index and places[source].startswith(_SCRATCH):
            free[places[source][len(_SCRATCH)]].append(places[source])


def _direct(
    section: Section, index: int, name: str | None, vectors: Collection[str], last: Mapping[int, int]
) -> str | None:
    """The place of the held matrix that a node becomes, where nobody needs its old value any more."""
    if name is None or (_row(section, index) and name not in vectors):
        return None
    old = [k for k, node in enumerate(section.nodes) if node == Held(name)]
    return name if all(last[k] <= index for k in old) else None


def _taken(section: Section, index: int, scratch: dict[str, list[str]], free: dict[str, list[str]]) -> str:
    """Scratch that is free, or new.

    Vectors have their own, whose rows but the first stay zero, and so have numbers that are read as whole
    matrices: all but the first element stays zero.
    """
    kind = "s" if _lonely(section, index) else "v" if _row(section, index) else "t"
    if free[kind]:
        return free[kind].pop(0)
    name = f"{_SCRATCH}{kind}{len(scratch[kind])}"
    scratch[kind].append(name)
    return name


def _lonely(section: Section, index: int) -> bool:
    """Whether a node writes its first element alone, and something reads it whole."""
    node = section.nodes[index]
    if not isinstance(node, Computed) or node.opcode not in _NUMBERS:
        return False
    users = [each for each in section.nodes if isinstance(each, Computed) and index in each.sources]
    if any(each.in_place and each.sources[-1] == index for each in users):
        return False
    return any(
        each.opcode not in _OF_ELEMENTS and not (each.opcode is Opcode.MULT_3S and each.sources[0] != index)
        for each in users
    )


def _row(section: Section, index: int) -> bool:
    """Whether a node is a vector or a number: only its first row is ever not zero, or ever written."""
    node = section.nodes[index]
    match node:
        case Constant() | Held() | Given() | Read() | Put():
            return False
        case Computed(opcode, sources):
            if opcode in _ROWS:
                return True
            adds = opcode in (Opcode.ADD_33, Opcode.SUB_33)
            return adds and any(_row(section, source) for source in sources)


def _last_uses(section: Section) -> dict[int, int]:
    """The last node that needs each node; what stays is needed until the end."""
    last = dict.fromkeys(range(len(section.nodes)), -1)
    for index, node in enumerate(section.nodes):
        last.update(dict.fromkeys(sources_of(node), index))
    last.update(dict.fromkeys(section.held.values(), len(section.nodes)))
    return last
