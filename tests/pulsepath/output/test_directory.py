"""A directory is there whole or not at all, and what stood there before survives every failure."""

import pytest

from kinematics import MotionError
from kinematics.files.atomic_files import write_whole
from pulsepath.output.directory import KIND, is_ours, replace_directory, write_files


def fill(folder, text):
    (folder / "plan.json").write_text(f'{{"kind": "{KIND}"}}')
    (folder / "text").write_text(text)


def break_off(target, end):
    with replace_directory(target, force=True) as folder:
        fill(folder, "half")
        raise end


def tree(folder):
    return {
        path.relative_to(folder).as_posix(): path.is_file() and path.read_bytes()
        for path in folder.rglob("*")
    }


@pytest.fixture
def old(tmp_path):
    """An earlier plan."""
    folder = tmp_path / "out"
    folder.mkdir()
    fill(folder, "old")
    (folder / "only-old").touch()
    return folder


@pytest.mark.parametrize("deep", ["out", "a/b/out"])
def test_a_new_directory(tmp_path, deep):
    with replace_directory(tmp_path / deep, force=False) as folder:
        fill(folder, "new")
        assert not (tmp_path / deep).exists()
    assert tree(tmp_path / deep).keys() == {"plan.json", "text"}
    assert [path.name for path in (tmp_path / deep).parent.iterdir()] == ["out"]


def test_an_empty_directory_is_filled(tmp_path):
    (tmp_path / "out").mkdir()
    with replace_directory(tmp_path / "out", force=False) as folder:
        fill(folder, "new")
    assert is_ours(tmp_path / "out")


def test_the_mode_is_that_of_any_new_directory(tmp_path):
    (tmp_path / "other").mkdir()
    with replace_directory(tmp_path / "out", force=False):
        pass
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_force_replaces_all_of_it(tmp_path, old):
    with replace_directory(old, force=True) as folder:
        fill(folder, "new")
    assert tree(tmp_path) == {
        "out": False,
        "out/plan.json": b'{"kind": "pulsepath plan"}',
        "out/text": b"new",
    }


def test_a_link_keeps_pointing_to_the_directory(tmp_path, old):
    link = tmp_path / "link"
    link.symlink_to(old)
    with replace_directory(link, force=True) as folder:
        fill(folder, "new")
    assert link.is_symlink()
    assert (old / "text").read_text() == "new"


def test_without_force_nothing_is_touched(tmp_path, old):
    before = tree(tmp_path)
    with pytest.raises(MotionError, match="not empty"), replace_directory(old, force=False):
        pass
    assert tree(tmp_path) == before


@pytest.mark.parametrize("record", [None, "{}", "[]", "not JSON", '{"kind": "another tool"}'])
def test_force_spares_what_is_not_ours(tmp_path, record):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "thesis.txt").touch()
    if record is not None:
        (folder / "plan.json").write_text(record)
    before = tree(tmp_path)
    with (
        pytest.raises(MotionError, match="not written by pulsepath"),
        replace_directory(folder, force=True),
    ):
        pass
    assert tree(tmp_path) == before


def test_a_file_is_never_replaced(tmp_path):
    (tmp_path / "out").write_text("mine")
    with (
        pytest.raises(MotionError, match="not a directory"),
        replace_directory(tmp_path / "out", force=True),
    ):
        pass
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.parametrize("end", [OSError("disk full"), KeyboardInterrupt()])
def test_a_failure_leaves_what_was_there(tmp_path, old, end):
    before = tree(tmp_path)
    with pytest.raises(type(end)):
        break_off(old, end)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("end", [OSError("disk full"), KeyboardInterrupt()])
def test_a_failure_leaves_nothing_new(tmp_path, end):
    with pytest.raises(type(end)):
        break_off(tmp_path / "a" / "b" / "out", end)
    assert tree(tmp_path) == {}


def test_a_failure_at_the_last_step_brings_the_old_one_back(tmp_path, old, monkeypatch):
    before = tree(tmp_path)
    rename = type(old).rename

    def refusing(path, target):
        if target == old and path.name != "old":
            raise OSError("cannot rename")
        return rename(path, target)

    monkeypatch.setattr(type(old), "rename", refusing)
    with (
        pytest.raises(OSError, match="cannot rename"),
        replace_directory(old, force=True) as folder,
    ):
        fill(folder, "new")
    monkeypatch.undo()
    assert tree(tmp_path) == before


def test_a_file_is_written_whole(tmp_path):
    write_whole(tmp_path / "track.json", "first")
    write_whole(tmp_path / "track.json", "second")
    assert tree(tmp_path) == {"track.json": b"second"}
    with pytest.raises(UnicodeEncodeError):
        write_whole(tmp_path / "track.json", "third \udc00")
    assert tree(tmp_path) == {"track.json": b"second"}


def test_a_file_on_the_way_is_named(tmp_path):
    (tmp_path / "file").touch()
    target = tmp_path / "file" / "a" / "out"
    with (
        pytest.raises(MotionError, match="file is a file, not a directory"),
        replace_directory(target, force=False),
    ):
        pass
    with pytest.raises(MotionError, match="file is a file, not a directory"):
        write_files(target, {"x": b""}, force=False)


def test_what_cannot_be_made_is_told_by_its_own_name(tmp_path):
    place = tmp_path / "nowhere" / "out.csv"
    with pytest.raises(OSError, match="No such file") as refusal:
        write_whole(place, "x")
    assert refusal.value.filename == str(place)
