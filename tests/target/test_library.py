import pytest

from kalmanhdl.errors import DesignError
from kalmanhdl.target import device, device_names

KINDS = {
    *("add", "multiply", "compare", "select", "table", "shift", "leading_one"),
    *("context_read", "context_write", "register"),
}
PARTS = [(name, grade) for name in ("ecp5-25k", "ecp5-45k", "ecp5-85k") for grade in (6, 7, 8)]


def test_an_unknown_device_names_those_that_exist():
    with pytest.raises(DesignError) as caught:
        device("virtex", 8)
    known = "ecp5-25k, ecp5-45k, ecp5-85k"
    assert str(caught.value) == f"[target] device = 'virtex' is unknown: there are {known}"


@pytest.mark.parametrize("grade", [9, True, "6", None])
def test_an_unknown_grade_names_those_that_exist(grade):
    with pytest.raises(DesignError) as caught:
        device("ecp5-25k", grade)
    problem = f"[target] grade = {grade!r} is unknown: the speed grades of ecp5-25k are 6, 7, 8"
    assert str(caught.value) == problem


def test_a_model_for_tests_is_not_offered():
    assert device_names() == ("ecp5-25k", "ecp5-45k", "ecp5-85k")


@pytest.mark.parametrize(("name", "grade"), [*PARTS, ("unit", 1)])
def test_every_device_knows_every_delay(name, grade):
    part = device(name, grade)
    assert (part.name, part.grade) == (name, grade)
    assert set(part.delays) == KINDS
    assert all(part.delay_ns(kind, size) >= 0 for kind in KINDS for size in range(1, 100))


@pytest.mark.parametrize("kind", sorted(KINDS - {"context_write"}))
def test_a_faster_grade_is_not_slower(kind):
    slow, fast = device("ecp5-25k", 6), device("ecp5-25k", 8)
    assert all(fast.delay_ns(kind, size) <= slow.delay_ns(kind, size) for size in (4, 8, 16, 32))


def test_a_wider_adder_is_slower():
    part = device("ecp5-25k", 8)
    assert part.delay_ns("add", 8) < part.delay_ns("add", 16) < part.delay_ns("add", 64)


def test_on_the_unit_device_everything_takes_a_nanosecond():
    part = device("unit", 1)
    assert {kind: part.delay_ns(kind, 7) for kind in KINDS} == {
        kind: float(kind != "register") for kind in KINDS
    }
