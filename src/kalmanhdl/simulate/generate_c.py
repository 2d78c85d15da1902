"""A typed graph as straight-line C over blocks of tracks.

Per program the C has three functions: ``step`` computes one step of a block of tracks (in loops that
the compiler vectorises), ``watch`` counts what saturated in that step and keeps the extremes, and
``run`` loads, steps and stores. ``watch`` runs only if something saturated or if asked for.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files

from kalmanhdl.arithmetic.division import TableNewton, reciprocal_table
from kalmanhdl.graph.operations import Divide, Flag, Input, Quantise, Reciprocal, State, StateFlag
from kalmanhdl.numerics.typed import TypedGraph, Violation
from kalmanhdl.simulate.chunks import Chunk, split
from kalmanhdl.simulate.expression import Flag as FlagText
from kalmanhdl.simulate.expression import Kind, Value, Writer, signed_bits
from kalmanhdl.simulate.lowering import Lowering, lower

# A block's states, inputs and results stay in the first-level cache.
BLOCK = 128

# The flag of a step that starts a track.
INITIALISE = "initialise"


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """A value that enters or leaves a step, in an array of 64-bit limbs (no limbs: a flag, one byte).

    ``index`` is the operation whose value it is, ``low`` and ``high`` its bounds. In the C it is the
    member ``x<index>`` of a structure, of type ``kind``.
    """

    name: str
    index: int
    limbs: int
    kind: Kind
    low: int
    high: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """The C of one graph, and the order in which its arrays are handed over.

    ``counted`` are the operations that can leave their format, ``violations`` the quantised ones of the
    graph's violations, counted after those and only where they matter; ``watched`` are those whose
    extremes are kept.
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


def generate(graphs: Sequence[TypedGraph], minimum_bits: int = 0) -> tuple[str, tuple[Program, ...]]:
    """One C source for many graphs, and the programs in it.

    ``minimum_bits`` forces wider types than the values need; the results are the same.
    """
    programs = tuple(_program(f"p{i}", typed, minimum_bits) for i, typed in enumerate(graphs))
    limbs = max(2, -(-max((program.bits for program in programs), default=0) // 64))
    tables = sorted({g.division.index_bits for g in graphs if isinstance(g.division, TableNewton)})
    folder = files("kalmanhdl.simulate")
    parts = [f"#define WIDE_LIMBS {limbs}", f"enum {{ BLOCK = {BLOCK} }};"]
    parts += [(folder / name).read_text(encoding="utf-8") for name in ("wide.h", "engine.h")]
    parts += [_table(bits) for bits in tables]
    return "\n".join([*parts, *(program.text for program in programs)]), programs


def _table(index_bits: int) -> str:
    table = reciprocal_table(index_bits)
    entries, c_type = ", ".join(map(str, table)), "int32_t" if max(table) < 1 << 31 else "int64_t"
    return f"static const {c_type} reciprocal_table_{index_bits}[] = {{{entries}}};"


def _program(name: str, typed: TypedGraph, minimum_bits: int) -> Program:
    writer = Writer(minimum_bits)
    lowering = lower(typed, writer)
    operations = typed.graph.operations
    inputs = tuple(_port(lowering, o.name, i) for i, o in enumerate(operations) if isinstance(o, Input))
    flags = tuple(_port(lowering, o.name, i) for i, o in enumerate(operations) if isinstance(o, Flag))
    places = {o.name: i for i, o in enumerate(operations) if isinstance(o, State | StateFlag)}
    states = tuple(_port(lowering, key, places.get(key, root)) for key, root in typed.graph.states)
    outputs = tuple(_port(lowering, key, root) for key, root in typed.graph.outputs)
    kept = (Input, State, Quantise, Divide, Reciprocal)
    chosen = {i for i, o in enumerate(operations) if isinstance(o, kept)} | set(typed.graph.roots)
    watched = tuple(p for p in (_port(lowering, "", i) for i in sorted(chosen)) if p.limbs)
    counted = tuple(i for i, flag in lowering.saturations.items() if flag.known is not False)
    parts = _Parts(name, lowering, inputs, flags, states, outputs, counted, watched)
    sinks = _step_sinks(parts), _watch_sinks(parts)
    text = "\n".join([_structures(parts), _loops(parts, split(writer.statements, sinks)), _run(parts)])
    return Program(
        name=name,
        text=text,
        bits=writer.widest,
        inputs=inputs,
        flags=flags,
        states=states,
        outputs=outputs,
        counted=counted,
        violations=tuple(v.quantise for v in typed.violations),
        watched=watched,
    )


@dataclass(frozen=True, slots=True)
class _Parts:
    name: str
    lowering: Lowering
    inputs: tuple[Port, ...]
    flags: tuple[Port, ...]
    states: tuple[Port, ...]
    outputs: tuple[Port, ...]
    counted: tuple[int, ...]
    watched: tuple[Port, ...]

    @property
    def lanes(self) -> int:
        """Tracks are padded to whole vectors, where the compiler can make vectors at all."""
        return 16 if max(self.lowering.writer.kinds, default=Kind.INT32) <= Kind.INT64 else 1


def _port(lowering: Lowering, name: str, index: int) -> Port:
    signal = lowering.signals[index]
    if not isinstance(signal, Value):
        return Port(name=name, index=index, limbs=0, kind=Kind.INT32, low=0, high=1)
    low, high = signal.low, signal.high
    limbs = -(-signed_bits(low, high) // 64)
    return Port(name=name, index=index, limbs=limbs, kind=signal.kind, low=low, high=high)


def _next_states(parts: _Parts) -> list[str]:
    """The statements that keep the states of live tracks."""
    lowering, lines = parts.lowering, []
    for port, (_, root) in zip(parts.states, lowering.typed.graph.states, strict=True):
        if port.limbs:
            new = lowering.aligned(root, lowering.form(port.index).fraction).known(port.low, port.high)
            text = new.at(port.kind)
        else:
            text = lowering.flag(root).c
        place = f"x{port.index}[t]"
        if port.kind is Kind.WIDE:
            lines.append(f"next->{place} = wide_select(live, {text}, old->{place});")
        else:
            lines.append(f"next->{place} = live ? {text} : old->{place};")
    return lines


def _members(ports: Iterable[Port]) -> str:
    return " ".join(dict.fromkeys(f"{port.kind.c_type} x{port.index}[BLOCK];" for port in ports))


def _structures(parts: _Parts) -> str:
    extremes = " ".join(f"{p.kind.c_type} low{p.index}[1], high{p.index}[1];" for p in parts.watched)
    return f"""
typedef struct {{ int32_t live[BLOCK]; {_members((*parts.inputs, *parts.flags))} }} {parts.name}_in;
typedef struct {{ int32_t none; {_members(parts.states)} }} {parts.name}_state;
typedef struct {{ int32_t none; {_members(parts.outputs)} }} {parts.name}_out;
typedef struct {{ int32_t seen; {extremes} }} {parts.name}_extremes;"""


def _signal_text(parts: _Parts, port: Port) -> str:
    signal = parts.lowering.signals[port.index]
    return signal.at(port.kind) if isinstance(signal, Value) else signal.c


def _step_sinks(parts: _Parts) -> list[str]:
    """The lines of a step that use its variables: new states, outputs, and whether anything saturated."""
    hits = dict.fromkeys(f"hit |= {parts.lowering.saturations[i].c};" for i in parts.counted)
    outputs = dict.fromkeys(f"out->x{p.index}[t] = {_signal_text(parts, p)};" for p in parts.outputs)
    return [*_next_states(parts), *outputs, *hits]


def _watch_sinks(parts: _Parts) -> list[str]:
    """The lines that count what saturated and keep the extremes."""
    lowering = parts.lowering
    flags = [lowering.saturations[i] for i in parts.counted]
    flags += [_matters(parts, violation) for violation in lowering.typed.violations]
    lines = [f"counts[{n}] += {flag.c};" for n, flag in enumerate(flags)]
    for port in parts.watched:
        text = _signal_text(parts, port)
        low, high = f"e->low{port.index}[0]", f"e->high{port.index}[0]"
        less = "wide_less({}, {})" if port.kind is Kind.WIDE else "{} < {}"
        lines.append(f"if (!seen || {less.format(text, low)}) {low} = {text};")
        lines.append(f"if (!seen || {less.format(high, text)}) {high} = {text};")
    return lines


def _loops(parts: _Parts, chunks: Sequence[Chunk]) -> str:
    """The functions ``step`` and ``watch``, each calling one function a chunk."""
    name, count = parts.name, range(len(chunks))
    steps = " | ".join(f"{name}_step_{k}(groups, in, old, mid, next, out)" for k in count)
    watches = " | ".join(f"{name}_watch_{k}(tracks, in, old, mid, counts, e, e->seen)" for k in count)
    waiting = " ".join(f"{s.c_type} {s.name}[BLOCK];" for chunk in chunks for s in chunk.stores)
    functions = [f(parts, k, chunk) for k, chunk in enumerate(chunks) for f in (_step_chunk, _watch_chunk)]
    return f"""
typedef struct {{ int32_t none; {waiting} }} {name}_mid;
{"".join(functions)}
static int32_t {name}_step(int64_t groups, const {name}_in *in, const {name}_state *old, {name}_mid *mid,
                       {name}_state *next, {name}_out *out)
{{
    return {steps};
}}

static void {name}_watch(int64_t tracks, const {name}_in *in, const {name}_state *old, const {name}_mid *mid,
                        int64_t *counts, {name}_extremes *e)
{{
    e->seen = {watches};
}}"""


def _step_chunk(parts: _Parts, number: int, chunk: Chunk) -> str:
    name = parts.name
    stores = [f"mid->{s.name}[t] = {s.name};" for s in chunk.stores]
    # Inlined, the pointers would be restrict no longer; without the pragma gcc judges such a loop not
    # worth its vectors. Either costs most of the speed.
    simd = "#pragma omp simd reduction(|:any)" if parts.lanes > 1 else ""
    return f"""
__attribute__((noinline))
static int32_t {name}_step_{number}(int64_t groups, const {name}_in *restrict in,
        const {name}_state *restrict old, {name}_mid *restrict mid, {name}_state *restrict next,
        {name}_out *restrict out)
{{
    int32_t any = 0;
    {simd}
    for (int64_t t = 0; t < groups * {parts.lanes}; t++) {{
        const int32_t live = in->live[t];
        int32_t hit = 0;
        {_lines([*_body(chunk), *stores, *chunk.sinks[0]], 8)}
        any |= hit & live;
    }}
    return any;
}}
"""


def _watch_chunk(parts: _Parts, number: int, chunk: Chunk) -> str:
    name = parts.name
    return f"""
__attribute__((cold, noinline))
static int32_t {name}_watch_{number}(int64_t tracks, const {name}_in *restrict in,
        const {name}_state *restrict old, const {name}_mid *restrict mid, int64_t *restrict counts,
        {name}_extremes *restrict e, int32_t seen)
{{
    for (int64_t t = 0; t < tracks; t++) {{
        if (!in->live[t])
            continue;
        {_lines([*_body(chunk), *chunk.sinks[1]], 8)}
        seen = 1;
    }}
    return seen;
}}
"""


def _body(chunk: Chunk) -> list[str]:
    loads = [f"const {s.c_type} {s.name} = mid->{s.name}[t];" for s in chunk.loads]
    return [*loads, *(statement.text for statement in chunk.statements)]


def _matters(parts: _Parts, violation: Violation) -> FlagText:
    """The flag of a violation, under the commands where its value matters."""
    lowering = parts.lowering
    names = {port.name: port.index for port in parts.flags}
    never = FlagText(lowering.writer, "", False)
    starts = lowering.flag(names[INITIALISE]) if INITIALISE in names else never
    matters = (starts if violation.starting else never) | (starts.negated() if violation.running else never)
    return lowering.flag(violation.outside) & matters


def _load(port: Port, block: str, array: str, at: str) -> str:
    """The statement that fills a block with elements of an array of limbs, or of flag bytes."""
    if copy := _copy(port):
        return f"load_{copy}({block}, {array}, {at}, n);"
    loaded = f"wide_load((const uint64_t *){array} + ({at} + t) * {port.limbs}, {port.limbs})"
    value = loaded if port.kind is Kind.WIDE else f"wide_low({loaded})"
    return f"for (int64_t t = 0; t < n; t++) {block}[t] = {value};"


def _store(port: Port, block: str, array: str, at: str) -> str:
    """The statement that brings a block into an array."""
    if copy := _copy(port):
        return f"store_{copy}({block}, {array}, {at}, n);"
    value = f"{block}[t]" if port.kind is Kind.WIDE else f"wide_of({block}[t])"
    place = f"(uint64_t *){array} + ({at} + t) * {port.limbs}"
    return f"for (int64_t t = 0; t < n; t++) wide_store({place}, {port.limbs}, {value});"


def _lines(statements: Iterable[str], indent: int) -> str:
    return ("\n" + " " * indent).join(statements)


def _copy(port: Port) -> str | None:
    """Which of the copies of engine.h serves a port."""
    if not port.limbs:
        return "flags"
    return str(port.kind.value) if port.kind <= Kind.INT64 else None


def _run(parts: _Parts) -> str:
    name, states = parts.name, parts.states
    loads = [
        _load(p, f"b->in.x{p.index}", f"{array}[{k}]", "row")
        for array, ports in (("inputs", parts.inputs), ("flags", parts.flags))
        for k, p in enumerate(ports)
    ]
    first = [_load(p, f"old->x{p.index}", f"state[{k}]", "first") for k, p in enumerate(states)]
    last = [_store(p, f"old->x{p.index}", f"state[{k}]", "first") for k, p in enumerate(states)]
    records = [_store(p, f"next->x{p.index}", f"records[{k}]", "row") for k, p in enumerate(states)]
    outs = [_store(p, f"b->out.x{p.index}", f"outputs[{k}]", "row") for k, p in enumerate(parts.outputs)]
    extremes = [
        _store(p, f"b->extremes.{member}{p.index}", f"extremes[{2 * k + i}]", "0")
        for k, p in enumerate(parts.watched)
        for i, member in enumerate(("low", "high"))
    ]
    return f"""
typedef struct {{
    {name}_in in;
    {name}_mid mid;
    {name}_state states[2];
    {name}_out out;
    {name}_extremes extremes;
}} {name}_block;

/* Arrays are (steps, tracks), states (tracks). Returns 1 if something was watched, -1 without memory. */
int32_t {name}_run(int64_t steps, int64_t tracks, const void *const *inputs, const void *const *flags,
               const uint8_t *active, void *const *state, void *const *outputs, void *const *records,
               int64_t *counts, void *const *extremes, int32_t monitor)
{{
    {name}_block *b = calloc(1, sizeof *b);
    if (!b)
        return -1;
    for (int64_t first = 0; first < tracks; first += BLOCK) {{
        int64_t n = tracks - first < BLOCK ? tracks - first : BLOCK;
        {name}_state *old = &b->states[0], *next = &b->states[1];
        for (int64_t t = 0; t < BLOCK; t++) b->in.live[t] = t < n;
        {_lines(first, 8)}
        for (int64_t step = 0; step < steps; step++) {{
            int64_t row = step * tracks + first;
            {_lines(loads, 12)}
            if (active)
                for (int64_t t = 0; t < n; t++) b->in.live[t] = active[row + t] != 0;
            int64_t groups = (n + {parts.lanes - 1}) / {parts.lanes};
            int32_t any = {name}_step(groups, &b->in, old, &b->mid, next, &b->out);
            if (any || monitor)
                {name}_watch(n, &b->in, old, &b->mid, counts, &b->extremes);
            {_lines(outs, 12)}
            if (records) {{
                {_lines(records, 16)}
            }}
            {name}_state *swap = old;
            old = next;
            next = swap;
        }}
        {_lines(last, 8)}
    }}
    int32_t seen = b->extremes.seen;
    if (seen) {{
        int64_t n = 1;
        {_lines(extremes, 8)}
    }}
    free(b);
    return seen;
}}"""
