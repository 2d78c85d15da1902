import os
import time
from multiprocessing import get_context

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.toolchain import cache

parts = st.lists(st.text(max_size=4) | st.binary(max_size=4), max_size=4)


@given(parts, parts)
def test_only_equal_inputs_share_a_key(one, other):
    def raw(inputs):
        return [part.encode() if isinstance(part, str) else part for part in inputs]

    assert (cache.key(*one) == cache.key(*other)) == (raw(one) == raw(other))


def test_an_entry_is_made_once(own_cache):
    calls = []

    def make(folder):
        calls.append(folder)
        (folder / "result").write_text("42")

    for _ in range(3):
        assert (cache.entry("kind", ("in",), make) / "result").read_text() == "42"
    assert len(calls) == 1
    assert cache.find("kind", ("other",)) is None


def test_a_failed_result_leaves_nothing(own_cache):
    def make(folder):
        (folder / "half").write_text("x")
        raise RuntimeError("stopped in the middle")

    with pytest.raises(RuntimeError):
        cache.entry("kind", ("in",), make)
    assert cache.find("kind", ("in",)) is None
    assert list((own_cache / "unfinished").iterdir()) == []


def _slow(folder):
    for name in "abc":
        (folder / name).write_text(str(os.getpid()))
        time.sleep(0.02)


def _use(_):
    place = cache.entry("kind", ("same",), _slow)
    return tuple((place / name).read_text() for name in "abc")


def test_processes_at_once_all_see_one_whole_result(own_cache):
    with get_context("fork").Pool(4) as pool:
        seen = pool.map(_use, range(8))
    assert len(set(seen)) == 1
    assert len(set(seen[0])) == 1


def test_the_least_recently_used_entries_go_first(own_cache):
    old = time.time() - 7200
    places = {}
    for age, name in enumerate(("new", "used", "old")):
        places[name] = cache.entry("kind", (name,), lambda folder: (folder / "x").write_bytes(bytes(1000)))
        os.utime(places[name], (old - age, old - age))
    cache.find("kind", ("used",))
    cache.evict(2000)
    assert [name for name, place in places.items() if place.exists()] == ["new", "used"]


def test_what_was_used_within_the_hour_stays_whatever_its_size(own_cache):
    place = cache.entry("kind", ("big",), lambda folder: (folder / "x").write_bytes(bytes(1000)))
    cache.evict(0)
    assert place.exists()
