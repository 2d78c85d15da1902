"""A typed graph as straight-line C over groups of tracks."""

from collections.abc import Sequence
from importlib.resources import files

from kalmanhdl.arithmetic.division import TableNewton, reciprocal_table
from kalmanhdl.graph.operations import Divide, Flag, Input, Quantise, Reciprocal, State, StateFlag
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph, Violation
from kalmanhdl.simulate.assembly import Body, Parts, assembled, next_state, usual_flags
from kalmanhdl.simulate.expression import Flag as FlagText
from kalmanhdl.simulate.expression import Kind, Value, Writer
from kalmanhdl.simulate.generate_float import float_header, float_program
from kalmanhdl.simulate.lowering import Lowering, lower
from kalmanhdl.simulate.program import INITIALISE, Port, Program


def generate(
    graphs: Sequence[TypedGraph | FloatGraph], minimum_bits: int = 0
) -> tuple[str, tuple[Program, ...]]:
    """One C source for many graphs, and the programs in it.

    ``minimum_bits`` forces wider types than the integers need; the results are the same.
    """
    tables: dict[tuple[int, ...], str] = {}
    programs = tuple(
        float_program(f"p{i}", graph)
        if isinstance(graph, FloatGraph)
        else _program(f"p{i}", graph, minimum_bits, tables)
        for i, graph in enumerate(graphs)
    )
    limbs = max(2, -(-max((program.bits for program in programs), default=0) // 64))
    integers = [graph for graph in graphs if isinstance(graph, TypedGraph)]
    divisions = sorted({g.division.index_bits for g in integers if isinstance(g.division, TableNewton)})
    folder = files("kalmanhdl.simulate")
    parts = [f"#define WIDE_LIMBS {limbs}"]
    parts += [(folder / name).read_text(encoding="utf-8") for name in ("wide.h", "engine.h")]
    parts += float_header([graph.form for graph in graphs if isinstance(graph, FloatGraph)])
    parts += [_table(f"reciprocal_table_{bits}", reciprocal_table(bits)) for bits in divisions]
    parts += [_table(name, rows) for rows, name in tables.items()]
    return "\n".join([*parts, *(program.text for program in programs)]), programs


def _table(name: str, rows: Sequence[int]) -> str:
    return f"static const int32_t {name}[] = {{{', '.join(map(str, rows))}}};"


def _program(name: str, typed: TypedGraph, minimum_bits: int, tables: dict[tuple[int, ...], str]) -> Program:
    operations = typed.graph.operations
    lowering = lower(typed, Writer(minimum_bits, tables=tables))
    quickly = lower(typed, Writer(minimum_bits, optimistic=True, tables=tables))
    given = usual_flags(o.name for o in operations if isinstance(o, Flag))
    usually = lower(typed, Writer(minimum_bits, optimistic=True, tables=tables), given)
    inputs = tuple(_port(lowering, o.name, i) for i, o in enumerate(operations) if isinstance(o, Input))
    flags = tuple(_port(lowering, o.name, i) for i, o in enumerate(operations) if isinstance(o, Flag))
    places = {o.name: i for i, o in enumerate(operations) if isinstance(o, State | StateFlag)}
    states = tuple(_port(lowering, key, places.get(key, root)) for key, root in typed.graph.states)
    outputs = tuple(_port(lowering, key, root) for key, root in typed.graph.outputs)
    kept = (Input, State, Quantise, Divide, Reciprocal)
    chosen = {i for i, o in enumerate(operations) if isinstance(o, kept)} | set(typed.graph.roots)
    watched = tuple(p for p in (_port(lowering, "", i) for i in sorted(chosen)) if not p.flag)
    counted = tuple(i for i, flag in lowering.saturations.items() if flag.known is not False)
    seen = _watch_sinks(lowering, flags, watched, counted)
    parts = Parts(
        name=name,
        inputs=inputs,
        flags=flags,
        states=states,
        outputs=outputs,
        watched=watched,
        counts=len(counted) + len(typed.violations),
        step=_body(quickly, states, outputs, _hits(quickly)),
        usual=_body(usually, states, outputs, _hits(usually)),
        watch=_body(lowering, states, outputs, seen),
    )
    return Program(
        name=name,
        text=assembled(parts),
        bits=max(each.writer.widest for each in (lowering, quickly, usually)),
        inputs=inputs,
        flags=flags,
        states=states,
        outputs=outputs,
        counted=counted,
        violations=tuple(v.quantise for v in typed.violations),
        watched=watched,
    )


def _port(lowering: Lowering, name: str, index: int) -> Port:
    signal = lowering.signals[index]
    if isinstance(signal, Value):
        return Port(name=name, index=index, kind=signal.kind, low=signal.low, high=signal.high, flag=False)
    return Port(name=name, index=index, kind=Kind.INT32, low=-1, high=0, flag=True)


def _next_states(lowering: Lowering, states: Sequence[Port]) -> list[str]:
    """The statements that give states their next values."""
    lines = []
    for port, (_, root) in zip(states, lowering.typed.graph.states, strict=True):
        if port.flag:
            text = lowering.flag(root).c
        else:
            assert isinstance(port.kind, Kind)
            new = lowering.aligned(root, lowering.form(port.index).fraction).known(port.low, port.high)
            text = new.at(port.kind)
        lines.append(next_state(port, text))
    return lines


def _signal_text(lowering: Lowering, port: Port) -> str:
    signal = lowering.signals[port.index]
    if isinstance(signal, Value):
        assert isinstance(port.kind, Kind)
        return signal.at(port.kind)
    return signal.c


def _body(
    lowering: Lowering, states: Sequence[Port], outputs: Sequence[Port], further: Sequence[str]
) -> Body:
    """A step that gives new states and outputs, and has further lines that use its variables."""
    texts = dict.fromkeys(f"out->x{p.index} = {_signal_text(lowering, p)};" for p in outputs)
    # Sinks first: they may write statements.
    sinks = [*_next_states(lowering, states), *texts, *further]
    return Body(lowering.writer.statements, sinks)


def _hits(lowering: Lowering) -> list[str]:
    """The lines that tell whether anything left its format, or is not what the step took it for."""
    flags = [flag.nonzero for flag in lowering.saturations.values() if flag.known is not False]
    return [f"out->hit |= {text};" for text in dict.fromkeys([*flags, *lowering.writer.surprises])]


def _watch_sinks(
    lowering: Lowering, flags: Sequence[Port], watched: Sequence[Port], counted: Sequence[int]
) -> list[str]:
    """The lines that count what saturated and keep the extremes."""
    hits = [lowering.saturations[i] for i in counted]
    hits += [_matters(lowering, flags, violation) for violation in lowering.typed.violations]
    lines = [f"w->counts[{n}] -= {flag.c} & in->live;" for n, flag in enumerate(hits)]
    for port in watched:
        kind, text = port.kind.c_type, _signal_text(lowering, port)
        for end, nearer in (("low", "minimum"), ("high", "maximum")):
            place = f"w->{end}{port.index}"
            lines.append(f"{place} = {nearer}_{kind}({place}, select_{kind}(in->live, {text}, {place}));")
    return lines


def _matters(lowering: Lowering, flags: Sequence[Port], violation: Violation) -> FlagText:
    """The flag of a violation, under the commands where its value matters."""
    names = {port.name: port.index for port in flags}
    never = FlagText(lowering.writer, "", False)
    starts = lowering.flag(names[INITIALISE]) if INITIALISE in names else never
    matters = (starts if violation.starting else never) | (starts.negated() if violation.running else never)
    return lowering.flag(violation.outside) & matters
