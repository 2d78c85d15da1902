"""The C of a program: one step of a group of tracks, in the loops that run it over all of them.

A group is as many tracks as the C has lanes. Per program the C has these functions: ``step`` computes one
step of a group, and may take it that nothing saturates; ``usual`` does so for groups in which every
measurement is there and no track starts, of which most steps are; ``watch`` computes a step whatever happens,
counts what saturated and keeps the extremes; ``keep`` gives tracks without a step their old states; ``run``
loads, steps and stores. ``watch`` runs only where a step found that something saturated, or if asked for.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from kalmanhdl.simulate.chunks import Chunk, split
from kalmanhdl.simulate.expression import Kind, Statement, cast, literal_text
from kalmanhdl.simulate.program import INITIALISE, ROWS, FloatKind, Port


@dataclass(frozen=True, slots=True)
class Body:
    """Statements, and the lines that use their variables."""

    statements: Sequence[Statement]
    sinks: Sequence[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What a program is made of. ``counts`` are the integers of ``counts``, of what ``watch`` keeps.

    ``usual`` is the step with the flags of ``usual_flags``.
    """

    name: str
    inputs: tuple[Port, ...]
    flags: tuple[Port, ...]
    states: tuple[Port, ...]
    outputs: tuple[Port, ...]
    watched: tuple[Port, ...]
    counts: int
    step: Body
    usual: Body
    watch: Body


def usual_flags(names: Iterable[str]) -> dict[str, bool]:
    """The flags of most steps: nothing starts, and every measurement is there."""
    return {name: name != INITIALISE for name in names}


def assembled(parts: Parts) -> str:
    """The C of a program."""
    bodies = {"step": parts.step, "usual": parts.usual, "watch": parts.watch}
    functions = [_functions(parts, what, body) for what, body in bodies.items()]
    # A program made quickly has fewer functions.
    functions[1] = f"#ifdef __OPTIMIZE__\n{functions[1]}\n#endif"
    texts = [_structures(parts), *functions, _keep(parts), _load_flags(parts), _group(parts), _run(parts)]
    return "\n".join(texts)


def next_state(port: Port, text: str) -> str:
    """The line that gives a state its next value."""
    return f"next->x{port.index} = {text};"


def _members(ports: Iterable[Port]) -> str:
    return " ".join(dict.fromkeys(f"{port.kind.c_type} x{port.index};" for port in ports))


def _structures(parts: Parts) -> str:
    extremes = " ".join(f"{p.kind.c_type} low{p.index}, high{p.index};" for p in parts.watched)
    counts = parts.counts
    return f"""
typedef struct {{ i32 live; {_members((*parts.inputs, *parts.flags))} }} {parts.name}_in;
typedef struct {{ {_members(parts.states)} }} {parts.name}_state;
typedef struct {{ i32 hit; {_members(parts.outputs)} }} {parts.name}_out;
enum {{ {parts.name}_counts = {counts} }};
typedef struct {{ i32 seen; i32 counts[{counts}]; {extremes} }} {parts.name}_watched;"""


def _functions(parts: Parts, what: str, body: Body) -> str:
    """The function ``step``, ``usual`` or ``watch``, calling one function a chunk."""
    name, chunks = parts.name, split(body.statements, body.sinks)
    waiting = " ".join(f"{s.c_type} {s.name};" for chunk in chunks for s in chunk.stores)
    given = f"const {name}_in *restrict in, const {name}_state *restrict old"
    given += f", {name}_state *restrict next, {name}_out *restrict out"
    given, passed = (f"{given}, {name}_watched *restrict w", ", w") if what == "watch" else (given, "")
    inner = f"{given}, {name}_{what}_mid *restrict mid"
    texts = [f"typedef struct {{ {waiting} }} {name}_{what}_mid;"]
    for k, chunk in enumerate(chunks):
        texts.append(_function(f"{name}_{what}_{k}", inner, [*_body(chunk), *chunk.sinks]))
    calls = [f"{name}_{what}_{k}(in, old, next, out{passed}, &mid);" for k in range(len(chunks))]
    lines = ["out->hit = (i32){0};", f"{name}_{what}_mid mid;", *calls]
    return "\n".join([*texts, _function(f"{name}_{what}", given, lines)])


def _keep(parts: Parts) -> str:
    name = parts.name
    given = f"i32 live, const {name}_state *restrict old, {name}_state *restrict next"
    places = [(f"x{port.index}", port.kind.c_type) for port in parts.states]
    lines = [f"next->{x} = select_{kind}(live, next->{x}, old->{x});" for x, kind in places]
    return _function(f"{name}_keep", given, lines)


def _function(name: str, parameters: str, lines: Iterable[str]) -> str:
    return f"CALL void {name}({parameters})\n{{\n    {_lines(lines, 4)}\n}}\n"


def _body(chunk: Chunk) -> list[str]:
    loads = [f"const {s.c_type} {s.name} = mid->{s.name};" for s in chunk.loads]
    stores = [f"mid->{s.name} = {s.name};" for s in chunk.stores]
    return [*loads, *(statement.text for statement in chunk.statements), *stores]


def _load(port: Port, array: str, at: str) -> str:
    """A group of elements of an array, as the port's kind."""
    if port.flag:
        return f"-load_uint8({array}, {at}, n)"
    if isinstance(port.kind, FloatKind):
        return f"load_{port.kind.c_type}({array}, {at}, n)"
    if port.limbs:
        return cast(f"load_limbs({array}, {at}, n, {port.limbs})", Kind.WIDE, port.kind)
    return cast(f"load_{port.row}({array}, {at}, n)", ROWS[port.row][2], port.kind)


def _store(port: Port, value: str, array: str, at: str) -> str:
    """The statement that brings a group into an array."""
    if port.flag:
        return f"store_uint8({array}, {at}, n, -{value});"
    if isinstance(port.kind, FloatKind):
        return f"store_{port.kind.c_type}({array}, {at}, n, {value});"
    if port.limbs:
        return f"store_limbs({array}, {at}, n, {port.limbs}, {cast(value, port.kind, Kind.WIDE)});"
    return f"store_{port.row}({array}, {at}, n, {cast(value, port.kind, ROWS[port.row][2])});"


def _store_extreme(port: Port, value: str, array: str) -> str:
    """The statement that brings what was watched into an array, of limbs or else of 64 bits."""
    if port.limbs or isinstance(port.kind, FloatKind):
        return _store(port, value, array, "0")
    return f"store_int64({array}, 0, n, {cast(value, port.kind, Kind.INT64)});"


def _lines(statements: Iterable[str], indent: int) -> str:
    return ("\n" + " " * indent).join(statements)


def _load_flags(parts: Parts) -> str:
    name = parts.name
    loads = [f"in->x{p.index} = {_load(p, f'flags[{k}]', 'at')};" for k, p in enumerate(parts.flags)]
    given = f"{name}_in *in, const void *const *flags, int64_t at, int64_t n"
    return f"INLINE void {name}_load_flags({given})\n{{\n    {_lines(loads, 4)}\n}}\n"


def _group(parts: Parts) -> str:
    name = parts.name
    loads = [f"b->in.x{p.index} = {_load(p, f'given[{k}]', 'place')};" for k, p in enumerate(parts.inputs)]
    records = [_store(p, f"next->x{p.index}", f"records[{k}]", "at") for k, p in enumerate(parts.states)]
    outs = [_store(p, f"b->out.x{p.index}", f"outputs[{k}]", "at") for k, p in enumerate(parts.outputs)]
    flags = usual_flags(port.name for port in parts.flags)
    alike = [f"all_alike(flags[{k}], at, {int(value)})" for k, value in enumerate(flags.values())]
    rows = [
        f"{_element(p)} row{k}[GROUPS_OF({name}_state) * LANES];"
        for k, p in enumerate(parts.inputs)
        if p.narrows
    ]
    return f"""
typedef struct {{
    {name}_in in;
    {name}_out out;
    {name}_watched watched;
    int32_t watches;
    {name}_state states[2][GROUPS_OF({name}_state)];
    {_lines(rows, 4)}
}} {name}_block;

/* A step of n tracks: from element `place` of rows of inputs on, from element `at` of other arrays. */
INLINE void {name}_group({name}_block *b, const {name}_state *old, {name}_state *next, int64_t place,
                         int64_t at, int64_t n, const void *const *given, const void *const *flags,
                         const uint8_t *active, void *const *outputs, void *const *records, int64_t *counts,
                         int32_t monitor)
{{
    {_lines(loads, 4)}
    b->in.live = first_lanes(n);
    if (active)
        b->in.live &= -load_uint8(active, at, n);
    int32_t usual = 0;
#ifdef __OPTIMIZE__
    if ((usual = {" & ".join(["!monitor & (n == LANES)", *alike])}))
        {name}_usual(&b->in, old, next, &b->out);
#endif
    if (!usual) {{
        {name}_load_flags(&b->in, flags, at, n);
        if (!monitor)
            {name}_step(&b->in, old, next, &b->out);
    }}
    if (monitor || any(b->out.hit & b->in.live)) {{
        if (usual)
            {name}_load_flags(&b->in, flags, at, n);
        {name}_watch(&b->in, old, next, &b->out, &b->watched);
        b->watched.seen |= b->in.live;
        if (++b->watches == INT32_MAX)  /* What a lane can count. */
            b->watches = sum_up({name}_counts, b->watched.counts, counts);
    }}
    if (active || n < LANES)
        {name}_keep(b->in.live, old, next);
    {_lines(outs, 4)}
    if (records) {{
        {_lines(records, 8)}
    }}
}}
"""


def _element(port: Port) -> str:
    """The C type of an array's elements."""
    return f"{port.row}_t"


def _rows(parts: Parts) -> list[str]:
    """The lines that give the inputs of a step, from one element on."""
    lines = []
    for k, port in enumerate(parts.inputs):
        at = f"at * {port.limbs}" if port.limbs else "at"
        line = f"(const {_element(port)} *)inputs[{k}] + {at}"
        if port.narrows:
            low = f"INT64_C({port.low})" if port.low > -(1 << 63) else "INT64_MIN"
            taken = f"take_{port.row}(inputs[{k}], at, end - first, active, {low}, &above[{k}], b->row{k})"
            line = f"in64[{k}] ? {taken} : {line}"
        lines.append(f"given[{k}] = {line};")
    return lines


def _run(parts: Parts) -> str:
    name, states = parts.name, parts.states
    first = [f"old->x{p.index} = {_load(p, f'state[{k}]', 'track')};" for k, p in enumerate(states)]
    last = [_store(p, f"old->x{p.index}", f"state[{k}]", "track") for k, p in enumerate(states)]
    # A range that holds nothing, to begin with.
    bounds = [(p, f"b->watched.low{p.index}", p.high) for p in parts.watched]
    bounds += [(p, f"b->watched.high{p.index}", p.low) for p in parts.watched]
    empty = [
        f"{place} = {literal_text(limit, p.kind)};" for p, place, limit in bounds if isinstance(p.kind, Kind)
    ]
    extremes = [_store_extreme(p, place, f"extremes[{k}]") for k, (p, place, _) in enumerate(bounds)]
    return f"""
/* Arrays are (steps, tracks), states (tracks), extremes (lanes), first all least ones, then the greatest.
   Inputs that are `in64` come as int64_t, and `above` gets the bits of what they are above their least ones.
   Returns 1 if something was watched, -1 without memory. */
int32_t {name}_run(int64_t steps, int64_t tracks, const void *const *inputs, const uint8_t *in64,
               uint64_t *above, const void *const *flags, const uint8_t *active, void *const *state,
               void *const *outputs, void *const *records, int64_t *counts, void *const *extremes,
               int32_t monitor)
{{
    {name}_block *b = aligned_alloc(_Alignof({name}_block), sizeof *b);
    if (!b)
        return -1;
    memset(&b->watched, 0, sizeof b->watched);
    b->watches = 0;
    uint64_t surroundings = begin_arithmetic();
    {_lines(empty, 4)}
    enum {{ TRACKS = GROUPS_OF({name}_state) * LANES }};
    for (int64_t first = 0; first < tracks; first += TRACKS) {{
        int64_t end = tracks - first < TRACKS ? tracks : first + TRACKS;
        for (int64_t track = first; track < end; track += LANES) {{
            int64_t n = end - track < LANES ? end - track : LANES;
            {name}_state *old = &b->states[0][(track - first) / LANES];
            {_lines(first, 12)}
        }}
        for (int64_t step = 0; step < steps; step++) {{
            const {name}_state *old = b->states[step & 1];
            {name}_state *next = b->states[~step & 1];
            int64_t place = 0, at = step * tracks + first;
            const void *given[{max(len(parts.inputs), 1)}];
            {_lines(_rows(parts), 12)}
            for (; place + LANES <= end - first; place += LANES)
                {name}_group(b, old++, next++, place, at + place, LANES, given, flags, active, outputs,
                             records, counts, monitor);
            if (place < end - first)
                {name}_group(b, old, next, place, at + place, end - first - place, given, flags, active,
                             outputs, records, counts, monitor);
        }}
        for (int64_t track = first; track < end; track += LANES) {{
            int64_t n = end - track < LANES ? end - track : LANES;
            {name}_state *old = &b->states[steps & 1][(track - first) / LANES];
            {_lines(last, 12)}
        }}
    }}
    sum_up({name}_counts, b->watched.counts, counts);
    if (extremes) {{
        int64_t n = LANES;
        {_lines(extremes, 8)}
    }}
    int32_t seen = -any(b->watched.seen);
    end_arithmetic(surroundings);
    free(b);
    return seen;
}}"""
