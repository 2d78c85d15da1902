"""What the compiled simulators share: the streams of a design, and the C++ that names their ports."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

# From a Verilog name to a C++ expression.
Reach = Callable[[str], str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """A stream of one direction at the design's border: handshake ports and payload ports (name, width)."""

    valid: str
    ready: str
    payload: tuple[tuple[str, int], ...]

    @property
    def words(self) -> int:
        """64-bit words of one token: every port starts a new word, low word first."""
        return sum(-(-width // 64) for _, width in self.payload)


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """Wires of the top module that are recorded in every cycle in which the wire ``enable`` is high.

    At most ``most`` records are kept for each token that is sent.
    """

    enable: str
    wires: tuple[tuple[str, int], ...]
    most: int = 1

    @property
    def words(self) -> int:
        """64-bit words of one record: every wire starts a new word, low word first."""
        return sum(-(-width // 64) for _, width in self.wires)


@dataclass(frozen=True, slots=True, kw_only=True)
class Border:
    """Where a stream design meets the world: its clock, its reset, a stream in and a stream out.

    ``further`` are pairs of streams beside the first. ``watches`` are looks inside the design; the wires must
    be kept by an attribute ``keep``. Those of an instance have its name and a point before their own.
    """

    source: Stream
    sink: Stream
    watches: tuple[Watch, ...] = ()
    further: tuple[tuple[Stream, Stream], ...] = ()
    clock: str = "clk"
    reset: str = "rst"

    @property
    def pairs(self) -> tuple[tuple[Stream, Stream], ...]:
        """Every stream in with the stream out that belongs to it."""
        return ((self.source, self.sink), *self.further)


def pairs_header(border: Border, port: Reach) -> str:
    """The ports of a design for who drives it in C++, with the C++ of each."""
    lines = [
        f"constexpr size_t PAIRS = {len(border.pairs)};",
        f"void reset(Model &model, bool on) {{ set({port(border.reset)}, on); }}",
        "template <size_t> struct Pair;",
        *(line for number, pair in enumerate(border.pairs) for line in _pair(number, *pair, port)),
    ]
    return "\n".join(lines) + "\n"


def watches_header(border: Border, wire: Reach) -> str:
    """The watches of a design for ``stream_harness.cc``, with the C++ of wires inside it."""
    looks = [_watch(number, watch, wire) for number, watch in enumerate(border.watches)]
    return f"void watch(Model &model, Watched *watched) {{{''.join(looks)} }}\n"


def _pair(number: int, source: Stream, sink: Stream, reach: Reach) -> list[str]:
    return [
        f"template <> struct Pair<{number}> {{",
        f"    static constexpr size_t in_words = {source.words}, out_words = {sink.words};",
        f"    static void offer(Model &model, bool on) {{ set({reach(source.valid)}, on); }}",
        f"    static void take(Model &model, bool on) {{ set({reach(sink.ready)}, on); }}",
        f"    static bool accepted(const Model &model) {{ return bit({reach(source.ready)}); }}",
        f"    static bool offered(const Model &model) {{ return bit({reach(sink.valid)}); }}",
        "    static void send(Model &model, const uint64_t *words) {"
        f"{_calls('put', source.payload, reach)} }}",
        "    static void receive(const Model &model, uint64_t *words) {"
        f"{_calls('get', sink.payload, reach)} }}",
        "};",
    ]


def _calls(function: str, ports: Sequence[tuple[str, int]], reach: Reach) -> str:
    calls, word = "", 0
    for name, width in ports:
        calls += f" {function}<{width}>({reach(name)}, words + {word});"
        word += -(-width // 64)
    return calls


def _watch(number: int, watch: Watch, reach: Reach) -> str:
    body = _calls("get", watch.wires, reach)
    enabled = f"bit({reach(watch.enable)})"
    return f" if (uint64_t *words = watched[{number}].next({enabled})) {{{body} }}"
