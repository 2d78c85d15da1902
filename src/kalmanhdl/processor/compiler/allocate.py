"""Where every matrix of a section stands in the data store."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.compiler.graph import Computed, Constant, Given, Held, Section
from kalmanhdl.processor.compiler.trace import HELD, Traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import Opcode

_ROWS = {Opcode.MULT_31, Opcode.RECIP, Opcode.DET_33, Opcode.PICK}
"""Instructions that leave elements of their destination as they were."""

GIVEN = ("z", "V")
_SCRATCH = "_"


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """Names of matrices by address: the lasting ones, then scratch for vectors, then for matrices.

    ``of[section][node]`` is the name of each node's place.
    """

    names: tuple[str, ...]
    of: Mapping[str, Mapping[int, str]]


def allocate(filter_: Traced, core: Core) -> Places:
    """A place for every node: scratch is used again once nobody needs what is in it.

    Raises ProgramError where the data store is too small.
    """
    lasting = [*HELD, *GIVEN, *filter_.constants]
    scratch: dict[str, list[str]] = {"v": [], "t": []}
    of = {each.name: _of_section(each, scratch) for each in (filter_.start, filter_.step)}
    names = (*lasting, *scratch["v"], *scratch["t"])
    if len(names) > core.matrices:
        raise ProgramError(
            f"the filter needs {len(names)} matrices and the data store has {core.matrices}: enlarge it"
        )
    return Places(names=names, of=of)


def _of_section(section: Section, scratch: dict[str, list[str]]) -> dict[int, str]:
    live = section.live
    last = _last_uses(section, live)
    results = {node: name for name, node in section.held.items()}
    places: dict[int, str] = {}
    free = {kind: list(names) for kind, names in scratch.items()}
    for index in live:
        node = section.nodes[index]
        match node:
            case Constant(name) | Held(name) | Given(name, _):
                places[index] = name
            case Computed():
                for source in set(node.sources):
                    if last[source] == index and places[source].startswith(_SCRATCH):
                        free[places[source][len(_SCRATCH)]].append(places[source])
                places[index] = _direct(section, live, index, results, last) or _taken(
                    section, index, scratch, free
                )
    return places


def _direct(
    section: Section, live: Sequence[int], index: int, results: Mapping[int, str], last: Mapping[int, int]
) -> str | None:
    """The place of the held matrix that a node becomes, where nobody needs its old value any more."""
    name = results.get(index)
    if name is None or (_row(section, index) and name != "x"):
        return None
    old = [k for k in live if section.nodes[k] == Held(name)]
    return name if all(last[k] <= index for k in old) else None


def _taken(section: Section, index: int, scratch: dict[str, list[str]], free: dict[str, list[str]]) -> str:
    """Scratch that is free, or new. Vectors have their own, whose rows but the first stay zero."""
    kind = "v" if _row(section, index) else "t"
    if free[kind]:
        return free[kind].pop(0)
    name = f"{_SCRATCH}{kind}{len(scratch[kind])}"
    scratch[kind].append(name)
    return name


def _row(section: Section, index: int) -> bool:
    """Whether a node is a vector or a number: only its first row is ever not zero, or ever written."""
    node = section.nodes[index]
    match node:
        case Constant() | Held() | Given():
            return False
        case Computed(opcode, sources):
            if opcode in _ROWS:
                return True
            adds = opcode in (Opcode.ADD_33, Opcode.SUB_33)
            return adds and any(_row(section, source) for source in sources)


def _last_uses(section: Section, live: Sequence[int]) -> dict[int, int]:
    """The last node that needs each node; what stays or is put out is needed until the end."""
    end = len(section.nodes)
    last = dict.fromkeys(live, -1)
    for index in live:
        node = section.nodes[index]
        if isinstance(node, Computed):
            last.update(dict.fromkeys(node.sources, index))
    last.update(dict.fromkeys([*section.held.values(), *(node for node, _ in section.outputs)], end))
    return last
