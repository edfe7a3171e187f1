"""A result never takes the place of something that came, or changed, while it was made."""

import os
import sys

import pytest

from kinematics import MotionError
from kinematics.files.atomic_files import Destination, stage_files


def files(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_it_is_refused_before_the_work(tmp_path):
    (tmp_path / "a").write_text("mine")
    (tmp_path / "folder").mkdir()
    with pytest.raises(MotionError, match="a exists; give --force"):
        Destination(tmp_path / "a")
    with pytest.raises(MotionError, match="is a directory"):
        Destination(tmp_path / "folder", force=True)


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
def test_a_link_that_leads_nowhere_is_something(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    with pytest.raises(MotionError, match="exists"):
        Destination(tmp_path / "a")


@pytest.mark.parametrize("links", [True, False])
def test_what_came_stays(tmp_path, monkeypatch, links):
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    to = Destination(tmp_path / "a.txt")
    (tmp_path / "a.txt").write_text("thesis")
    with pytest.raises(MotionError, match=r"put there by something else.*kept in .*a\.kept\.txt"):
        to.write("result")
    assert files(tmp_path) == {"a.txt": "thesis", "a.kept.txt": "result"}
    again = Destination(tmp_path / "a.txt", force=True)
    (tmp_path / "a.txt").write_text("thesis, second edition")
    with pytest.raises(MotionError, match="changed or replaced"):
        again.write("later")
    assert files(tmp_path) == {
        "a.txt": "thesis, second edition", "a.kept.txt": "result", "a.kept1.txt": "later"
    }  # fmt: skip


@pytest.mark.parametrize("links", [True, False])
def test_what_stood_there_is_replaced_by_force(tmp_path, monkeypatch, links):
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    (tmp_path / "a").write_text("before")
    Destination(tmp_path / "a", force=True).write("result")
    gone = Destination(tmp_path / "a", force=True)
    (tmp_path / "a").unlink()
    gone.write("again")
    assert files(tmp_path) == {"a": "again"}


@pytest.mark.parametrize("force", [True, False])
def test_all_or_none(tmp_path, force):
    if force:
        (tmp_path / "a").write_text("before")

    def write():
        with stage_files([Destination(tmp_path / name, force=force) for name in "abc"]) as made:
            for file, name in zip(made, "abc", strict=True):
                file.write_text(f"new {name}")
            (tmp_path / "b").write_text("thesis")

    with pytest.raises(MotionError, match="kept"):
        write()
    kept = {f"{name}.kept": f"new {name}" for name in "abc"}
    assert files(tmp_path) == kept | {"b": "thesis"} | ({"a": "before"} if force else {})


@pytest.mark.parametrize("name", ["old", "new", ".pulsepath"])
def test_any_name_will_do(tmp_path, name):
    def break_off():
        with Destination(tmp_path / name).stage() as file:
            file.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        break_off()
    assert files(tmp_path) == {}
    Destination(tmp_path / name).write("whole")
    assert files(tmp_path) == {name: "whole"}


def no_links(*args, **_):
    raise PermissionError(1, "no links on this file system")
