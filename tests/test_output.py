"""Folders of results: whole or not there, and nothing else is ever touched."""

import os
import stat
from pathlib import Path

import pytest

from kalmanhdl.errors import OutputError
from kalmanhdl.output import MARKER, check_file, check_folder, new_file, new_folder


def tree(folder):
    """Everything below a folder, with the contents of files."""
    return {
        str(path.relative_to(folder)): path.read_text() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def fill(out, text="new", **options):
    with new_folder(out, **options) as folder:
        (folder / "a.txt").write_text(text)


def test_a_folder_and_those_above_it_are_made(tmp_path):
    fill(tmp_path / "b" / "c" / "out")
    assert (tmp_path / "b/c/out/a.txt").read_text() == "new"
    assert sorted(os.listdir(tmp_path / "b/c")) == ["out"]


def test_a_made_folder_has_the_permissions_of_any_other(tmp_path):
    (tmp_path / "plain").mkdir()
    fill(tmp_path / "out")
    modes = {stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "out")}
    assert len(modes) == 1


def break_off(out, error, **options):
    with new_folder(out, **options) as folder:
        (folder / "a.txt").write_text("half")
        raise error


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OutputError])
def test_a_failure_leaves_nothing(tmp_path, error):
    with pytest.raises(error):
        break_off(tmp_path / "b" / "out", error)
    assert tree(tmp_path) == {}


def test_a_failure_leaves_the_earlier_build(tmp_path):
    fill(tmp_path / "out", "old")
    before = tree(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        break_off(tmp_path / "out", KeyboardInterrupt, force=True)
    assert tree(tmp_path) == before


def test_a_full_disk_is_one_message(tmp_path):
    with pytest.raises(OutputError, match=r"out: cannot be written: No space left on device"):
        break_off(tmp_path / "out", OSError(28, "No space left on device"))
    assert tree(tmp_path) == {}


def test_an_earlier_build_is_replaced_only_by_force(tmp_path):
    fill(tmp_path / "out", "old")
    with pytest.raises(OutputError, match="out: exists: name another folder, or replace it with --force"):
        fill(tmp_path / "out")
    assert (tmp_path / "out/a.txt").read_text() == "old"
    fill(tmp_path / "out", force=True)
    assert tree(tmp_path / "out") == {"a.txt": "new", MARKER: (tmp_path / "out" / MARKER).read_text()}
    assert os.listdir(tmp_path) == ["out"]


def test_force_spares_what_others_made(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/thesis.tex").write_text("years of work")
    before = tree(tmp_path)
    with pytest.raises(OutputError, match=r"out: was not made by kalmanhdl \(it has no file \.kalmanhdl\)"):
        fill(tmp_path / "out", force=True)
    assert tree(tmp_path) == before


def test_force_takes_an_empty_folder(tmp_path):
    (tmp_path / "out").mkdir()
    fill(tmp_path / "out", force=True)
    assert (tmp_path / "out/a.txt").read_text() == "new"


def test_a_folder_that_appears_meanwhile_is_spared(tmp_path):
    def meet(out):
        with new_folder(out):
            out.mkdir()
            (out / "theirs.txt").write_text("theirs")

    with pytest.raises(OutputError, match="exists"):
        meet(tmp_path / "out")
    assert tree(tmp_path) == {"out": None, "out/theirs.txt": "theirs"}


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "out").write_text("mine")
    for force in (False, True):
        with pytest.raises(OutputError, match="out: is a file"):
            fill(tmp_path / "out", force=force)
        with pytest.raises(OutputError, match="is no folder: choose another place"):
            fill(tmp_path / "out" / "deeper", force=force)
    assert tree(tmp_path) == {"out": "mine"}


def test_a_link_is_not_followed(tmp_path):
    fill(tmp_path / "real")
    (tmp_path / "out").symlink_to(tmp_path / "real")
    with pytest.raises(OutputError, match="out: is a link: name the folder itself"):
        fill(tmp_path / "out", force=True)
    assert (tmp_path / "real/a.txt").exists()


@pytest.mark.parametrize("out", [".", "..", "", "inner/..", "/"])
def test_the_working_folder_and_those_above_it_are_spared(tmp_path, monkeypatch, out):
    inner = tmp_path / "outer" / "here"
    (inner / "inner").mkdir(parents=True)
    for folder in (inner, inner.parent):
        (folder / MARKER).write_text("")
    monkeypatch.chdir(inner)
    before = tree(tmp_path)
    with pytest.raises(OutputError):
        fill(out, force=True)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("out", ["a\0b", "x" * 300, "y" * 5000])
def test_a_name_that_cannot_be_is_one_message(tmp_path, monkeypatch, out):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match=r"\A[^\n]{1,300}\Z"):
        fill(out)
    assert tree(tmp_path) == {}


def test_a_file_is_whole_or_as_before(tmp_path):
    def draw(path, *errors):
        with new_file(path, force=True) as aside:
            aside.write_text("new")
            for error in errors:
                raise error

    path = tmp_path / "schedule.png"
    path.write_text("old")
    with pytest.raises(OutputError, match=r"schedule\.png: cannot be written: No space left on device"):
        draw(path, OSError(28, "No space left on device"))
    assert tree(tmp_path) == {"schedule.png": "old"}
    draw(path)
    assert tree(tmp_path) == {"schedule.png": "new"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_told_before_the_work(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="no permission"):
            check_folder(tmp_path / "out")
    finally:
        tmp_path.chmod(0o700)


def written(path, **options):
    with new_file(path, **options) as aside:
        aside.write_text("new")


@pytest.mark.parametrize("use", [check_file, written])
def test_a_file_is_not_overwritten_but_by_force(tmp_path, use):
    path = tmp_path / "rows.csv"
    path.write_text("old")
    with pytest.raises(OutputError, match=r"exists: name another file, or replace it with --force"):
        use(path)
    assert tree(tmp_path) == {"rows.csv": "old"}
    use(path, force=True)


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("folder", "folder: is a folder: name a file"),
        ("link.csv", r"link\.csv: is a link: name the file itself"),
        ("dangling.csv", r"dangling\.csv: is a link: name the file itself"),
        ("queue", "queue: is no plain file: name another one"),
        ("nodir/x.csv", r"x\.csv: no folder .*nodir: make it, or choose another place"),
        ("rows.csv/x.csv", r"x\.csv: .*rows\.csv is no folder: choose another place"),
        ("a\0b/x.csv", r"cannot be written: .*null"),
        ("x" * 300, "cannot be written: File name too long"),
    ],
)
@pytest.mark.parametrize("use", [check_file, written])
def test_where_no_file_can_be_is_one_message(tmp_path, name, problem, force, use):
    (tmp_path / "folder").mkdir()
    (tmp_path / "rows.csv").write_text("mine")
    (tmp_path / "link.csv").symlink_to("rows.csv")
    (tmp_path / "dangling.csv").symlink_to("gone.csv")
    os.mkfifo(tmp_path / "queue")
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(OutputError, match=problem):
        use(tmp_path / name, force=force)
    assert sorted(os.listdir(tmp_path)) == before
    assert (tmp_path / "rows.csv").read_text() == "mine"


def test_a_file_that_appears_meanwhile_is_spared(tmp_path):
    path = tmp_path / "rows.csv"

    def meet():
        with new_file(path) as aside:
            aside.write_text("new")
            path.write_text("theirs")

    with pytest.raises(OutputError, match="exists"):
        meet()
    assert tree(tmp_path) == {"rows.csv": "theirs"}


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a folder in which nothing can be made")
def test_a_folder_that_takes_nothing_is_told_before_the_work():
    for check, path in ((check_file, "/proc/x.csv"), (check_folder, "/proc/x")):
        with pytest.raises(OutputError, match=r"/proc/x.*: cannot be written: .*/proc"):
            check(Path(path))
