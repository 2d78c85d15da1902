"""Whatever a design file holds, it loads or ends in one DesignError, soon."""

import copy
import functools
import json
import random
import time
import tomllib
import warnings
from pathlib import Path

import pytest

from kalmanhdl.design import Design
from kalmanhdl.design_file import loads
from kalmanhdl.errors import DesignError
from kalmanhdl.validation import KalmanhdlWarning

DESIGNS = sorted((Path(__file__).parents[1] / "designs").glob("*.toml"))
SECONDS = 2.0

STRANGE = [
    *(None, True, False, 0, -1, 1, 3, 10**30, -(10**400), 2**63, 1.5, -0.0, 1e308, 5e-324),
    *(float("nan"), float("inf"), -float("inf"), "", " ", "auto", "bound", "T", "1/0", "0/0", "9^9^9^9"),
    *("__import__('os').system('false')", "().__class__.__bases__", "lambda: 0", "T" * 10_000, "(" * 150),
    *("-" * 199 + "1", "1e999", "sqrt(-1)", "(-8)^(1/3)", "log(0)", "exp(1e9)", "x;y", "a\nb", "\0", "é∑"),
    *("Q12.20", "UQ0.0", "Q-5.9", "Q99999.99999", "module", "../../etc/passwd", "radix8", "$(id)", "`x`"),
    *([], [[]], [[[]]], [1], [1, 2, 3], ["a"], [["pi"]], [[1, 2], [3]], [[1, "T"], [0, 1]]),
    *([float("nan")], [[float("inf")]], [0] * 65, [[0] * 65] * 65, [[1e308] * 4] * 4, [[0] * 4] * 4),
    *([[1, 2], [2, 1]], [[-1]], [[1, 2, 0, 0], [2, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    *({}, {"a": 1}, {"diagonal": []}, {"diagonal": [1, 2]}, {"diagonal": "x"}, {"diagonal": [-1, 1, 1, 1]}),
    *({"width": 5000, "fraction": 2}, {"width": 8}, {"table": 10}, {"table": 10**9, "newton": 10**9}),
    *({"kind": "given"}, {"kind": []}, {"kind": "two_point"}, {f"k{i}": i for i in range(5000)}),
    *({f"c{i}": f"c{i + 1}" for i in range(200)}, {"a": "b", "b": "a"}, {"pi": 3}, {"T": "T"}),
]


def toml(value):
    """Any value as TOML, tables inline."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, bool):
        return str(value).lower()
    return "1979-05-27" if value is None else repr(value)


def text_of(tables):
    """A design file of changed tables."""
    lines = [f"{json.dumps(key)} = {toml(value)}" for key, value in tables.items()]
    return "\n".join(lines) + "\n"


def places(value, path=()):
    """The paths of everything inside a parsed file."""
    if not isinstance(value, dict | list):
        return
    for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*path, key)
        yield from places(entry, (*path, key))


def changed(tables, chance):
    """A file with one to three places replaced, removed, renamed, moved or added."""
    tables = copy.deepcopy(tables)
    for _ in range(chance.randint(1, 3)):
        spots = list(places(tables))
        if not spots:
            break
        *path, last = chance.choice(spots)
        parent = tables
        for key in path:
            parent = parent[key]
        match chance.randrange(6):
            case 0 | 1:
                parent[last] = copy.deepcopy(chance.choice(STRANGE))
            case 2:
                del parent[last]
            case 3 if isinstance(parent, dict):
                parent[chance.choice([str(last) + "s", "kind", "x", "", "a.b", "é", "\n"])] = parent.pop(last)
            case 4 if isinstance(parent, dict):
                parent["new"] = copy.deepcopy(chance.choice(STRANGE))
            case _:
                parent[last] = [parent[last]]
    return text_of(tables)


def flipped(content, chance):
    """Bytes with a few of them replaced, removed, doubled or cut off."""
    data = bytearray(content)
    for _ in range(chance.randint(1, 6)):
        spot = chance.randrange(len(data))
        match chance.randrange(4):
            case 0:
                data[spot] = chance.randrange(256)
            case 1:
                data[spot] = chance.choice(b'[]{}="\n.,#0123-e')
            case 2:
                del data[spot : spot + chance.randint(1, 20)]
            case _:
                data[spot:spot] = data[spot : spot + 30]
        if not data:
            return b"x"
    return bytes(data)


def load_or_refuse(load):
    """Whether it loaded; anything but a design or one short DesignError fails."""
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", KalmanhdlWarning)
        try:
            assert isinstance(load(), Design)
            loaded = True
        except DesignError as error:
            message = str(error)
            assert message
            assert len(message) < 1000
            assert "\n" not in message
            loaded = False
    assert time.process_time() - start < SECONDS
    return loaded


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_changed_tables_load_or_end_in_one_message(path):
    chance = random.Random(path.stem)
    tables = tomllib.loads(path.read_text())
    loaded = [load_or_refuse(lambda: loads(changed(tables, chance))) for _ in range(150)]
    assert not all(loaded)


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_changed_bytes_load_or_end_in_one_message(path, tmp_path):
    chance = random.Random(path.stem)
    broken = tmp_path / "broken.toml"
    for _ in range(100):
        broken.write_bytes(flipped(path.read_bytes(), chance))
        load_or_refuse(lambda: Design.load(broken))


@pytest.mark.parametrize("value", STRANGE, ids=lambda value: repr(value)[:20])
def test_every_key_refuses_or_takes_any_value(value):
    tables = tomllib.loads((DESIGNS[0].parent / "lee1997_paper_formats.toml").read_text())
    for path in [p for p in places(tables) if not isinstance(p[-1], int)]:
        copied = copy.deepcopy(tables)
        parent = copied
        for key in path[:-1]:
            parent = parent[key]
        parent[path[-1]] = value
        load_or_refuse(functools.partial(loads, text_of(copied)))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[" * 100_000,
        "a = " + "[" * 100_000,
        "a." * 50_000 + "b = 1",
        "[" + "a." * 50_000 + "b]",
        "\n".join(f"k{i} = {i}" for i in range(30_000)),
        "a = " + "9" * 100_000,
        'a = "' + "x" * 900_000 + '"',
        "a = { " + "b = { " * 20_000,
        "\n".join(f"[t{i}]" for i in range(30_000)),
        'name = "x"\nmodel = 3\n',
        "\x00" * 1000,
        '[model]\nkind = "linear"\nF = [' + "[0]," * 100_000 + "]",
        "\n".join(f"a{i}.b.c.d.e.f.g.h.i.j.k.l.m.n.o = 1" for i in range(20_000)),
        "\n".join(f"a{i}.b.c.d = 1" for i in range(60_000)),
        "x = {" + "a." * 50_000 + "b = 1}",
        "x = {" + ", ".join(f"a{i}.b.c.d.e = 1" for i in range(40_000)) + "}",
    ],
    ids=lambda text: repr(text[:15]),
)
def test_hostile_text_ends_in_one_message_soon(text):
    assert not load_or_refuse(lambda: loads(text))


@pytest.mark.parametrize(
    "content", [b"\xff\xfe\x00", b"\x7fELF" * 100, b"a = 1\n" * 400_000, b'n = "\xed\xa0\x80"']
)
def test_binary_and_huge_files_end_in_one_message(content, tmp_path):
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    assert not load_or_refuse(lambda: Design.load(path))


@pytest.mark.parametrize("path", ["/nowhere/x.toml", ".", "a\0b", "x" * 5000, ""])
def test_paths_that_are_no_files_end_in_one_message(path):
    assert not load_or_refuse(lambda: Design.load(path))
