"""What a program of the engine is: the C of one step, in the loops that run it over groups of tracks.

A group is as many tracks as the C has lanes. Per program the C has four functions: ``step`` computes one
step of a group, and may take it that nothing saturates; ``watch`` computes it whatever happens, counts what
saturated and keeps the extremes; ``keep`` gives tracks without a step their old states; ``run`` loads,
steps and stores. ``watch`` runs only where ``step`` found that something saturated, or if asked for.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from kalmanhdl.simulate.chunks import Chunk, split
from kalmanhdl.simulate.expression import Kind, Statement, cast, literal_text, signed_bits

# The narrowest arrays hold their integers as these types of the C; wider integers have arrays of limbs.
_ROWS = {
    "int16": (-(1 << 15), (1 << 15) - 1, Kind.INT32),
    "uint16": (0, (1 << 16) - 1, Kind.INT32),
    "int32": (-(1 << 31), (1 << 31) - 1, Kind.INT32),
    "uint32": (0, (1 << 32) - 1, Kind.INT64),
    "int64": (-(1 << 63), (1 << 63) - 1, Kind.INT64),
}

# The flag of a step that starts a track.
INITIALISE = "initialise"


@dataclass(frozen=True, slots=True)
class FloatKind:
    """A C type of floating-point numbers, whose raw integers have ``bits``; see ``float.h``."""

    c_type: str
    bits: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """A value that enters or leaves a step, in an array.

    ``index`` is the operation whose value it is, ``low`` and ``high`` the bounds of its raw integers. In
    the C it is the member ``x<index>`` of a structure, of type ``kind``.
    """

    name: str
    index: int
    kind: Kind | FloatKind
    low: int
    high: int
    flag: bool

    @property
    def limbs(self) -> int:
        """The 64-bit limbs of each of the array's integers, none if a type of NumPy holds them."""
        if isinstance(self.kind, FloatKind) and self.kind.bits <= 64:
            return 0
        return 0 if self.row in _ROWS or self.flag else -(-signed_bits(self.low, self.high) // 64)

    @property
    def row(self) -> str:
        """The type of the array: NumPy's narrowest for these bounds, uint8 for flags, uint64 of limbs."""
        if self.flag:
            return "uint8"
        if isinstance(self.kind, FloatKind):
            return next((f"uint{size}" for size in (16, 32) if self.kind.bits <= size), "uint64")
        fits = (name for name, (low, high, _) in _ROWS.items() if low <= self.low and self.high <= high)
        return next(fits, "uint64")


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """The C of one graph, and the order in which its arrays are handed over.

    ``counted`` are the operations that can leave their format, ``violations`` the values of the
    graph's violations, counted after those and only where they matter; ``watched`` are those whose
    extremes are kept. Without ``text`` there is no C for numbers of this kind.
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


@dataclass(frozen=True, slots=True)
class Body:
    """Statements, and the lines that use their variables."""

    statements: Sequence[Statement]
    sinks: Sequence[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What a program is made of. ``counts`` are the integers of ``counts``, of what ``watch`` keeps."""

    name: str
    inputs: tuple[Port, ...]
    flags: tuple[Port, ...]
    states: tuple[Port, ...]
    outputs: tuple[Port, ...]
    watched: tuple[Port, ...]
    counts: int
    step: Body
    watch: Body


def assembled(parts: Parts) -> str:
    """The C of a program."""
    functions = [_functions(parts, "step", parts.step), _functions(parts, "watch", parts.watch)]
    return "\n".join([_structures(parts), *functions, _keep(parts), _run(parts)])


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
    """The function ``step`` or ``watch``, calling one function a chunk."""
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
    return cast(f"load_{port.row}({array}, {at}, n)", _ROWS[port.row][2], port.kind)


def _store(port: Port, value: str, array: str, at: str) -> str:
    """The statement that brings a group into an array."""
    if port.flag:
        return f"store_uint8({array}, {at}, n, -{value});"
    if isinstance(port.kind, FloatKind):
        return f"store_{port.kind.c_type}({array}, {at}, n, {value});"
    if port.limbs:
        return f"store_limbs({array}, {at}, n, {port.limbs}, {cast(value, port.kind, Kind.WIDE)});"
    return f"store_{port.row}({array}, {at}, n, {cast(value, port.kind, _ROWS[port.row][2])});"


def _lines(statements: Iterable[str], indent: int) -> str:
    return ("\n" + " " * indent).join(statements)


def _run(parts: Parts) -> str:
    name, states = parts.name, parts.states
    loads = [
        f"b->in.x{p.index} = {_load(p, f'{array}[{k}]', 'at')};"
        for array, ports in (("inputs", parts.inputs), ("flags", parts.flags))
        for k, p in enumerate(ports)
    ]
    first = [f"old->x{p.index} = {_load(p, f'state[{k}]', 'track')};" for k, p in enumerate(states)]
    last = [_store(p, f"old->x{p.index}", f"state[{k}]", "track") for k, p in enumerate(states)]
    records = [_store(p, f"next->x{p.index}", f"records[{k}]", "at") for k, p in enumerate(states)]
    outs = [_store(p, f"b->out.x{p.index}", f"outputs[{k}]", "at") for k, p in enumerate(parts.outputs)]
    # A range that holds nothing, to begin with.
    bounds = [(p, f"b->watched.low{p.index}", p.high) for p in parts.watched]
    bounds += [(p, f"b->watched.high{p.index}", p.low) for p in parts.watched]
    empty = [
        f"{place} = {literal_text(limit, p.kind)};" for p, place, limit in bounds if isinstance(p.kind, Kind)
    ]
    extremes = [_store(p, place, f"extremes[{k}]", "0") for k, (p, place, _) in enumerate(bounds)]
    return f"""
typedef struct {{
    {name}_in in;
    {name}_out out;
    {name}_watched watched;
    int32_t watches;
    {name}_state states[2][GROUPS_OF({name}_state)];
}} {name}_block;

/* A step of the n tracks from element `at` of each array on. */
INLINE void {name}_group({name}_block *b, const {name}_state *old, {name}_state *next, int64_t at, int64_t n,
                         const void *const *inputs, const void *const *flags, const uint8_t *active,
                         void *const *outputs, void *const *records, int64_t *counts, int32_t monitor)
{{
    {_lines(loads, 4)}
    b->in.live = first_lanes(n);
    if (active)
        b->in.live &= -load_uint8(active, at, n);
    if (!monitor)
        {name}_step(&b->in, old, next, &b->out);
    if (monitor || any(b->out.hit & b->in.live)) {{
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

/* Arrays are (steps, tracks), states (tracks), extremes (lanes), first all least ones, then the greatest.
   Returns 1 if something was watched, -1 without memory. */
int32_t {name}_run(int64_t steps, int64_t tracks, const void *const *inputs, const void *const *flags,
               const uint8_t *active, void *const *state, void *const *outputs, void *const *records,
               int64_t *counts, void *const *extremes, int32_t monitor)
{{
    {name}_block *b = aligned_alloc(_Alignof({name}_block), sizeof *b);
    if (!b)
        return -1;
    memset(b, 0, sizeof *b);
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
            int64_t track = first;
            for (; track + LANES <= end; track += LANES)
                {name}_group(b, old++, next++, step * tracks + track, LANES, inputs, flags, active, outputs,
                             records, counts, monitor);
            if (track < end)
                {name}_group(b, old, next, step * tracks + track, end - track, inputs, flags, active, outputs,
                             records, counts, monitor);
        }}
        for (int64_t track = first; track < end; track += LANES) {{
            int64_t n = end - track < LANES ? end - track : LANES;
            {name}_state *old = &b->states[steps & 1][(track - first) / LANES];
            {_lines(last, 12)}
        }}
    }}
    sum_up({name}_counts, b->watched.counts, counts);
    int64_t n = LANES;
    {_lines(extremes, 4)}
    int32_t seen = -any(b->watched.seen);
    end_arithmetic(surroundings);
    free(b);
    return seen;
}}"""
