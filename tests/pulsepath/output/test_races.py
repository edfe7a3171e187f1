"""What comes to the place of a result while that is made is never replaced, by any command."""

import shutil

import pytest

import kinematics.files.atomic_files
import pulsepath.job
import pulsepath.output.directory
import pulsepath.parts_job
import pulsepath.sections
from kinematics import MotionError
from kinematics.files.atomic_files import stage_directory
from pulsepath.output.directory import KIND, replace_directory
from pulsepath.requests import InputRequest

LINE = 'schema = 1\nlength = "mm"\n[[segment]]\nline = { to = [0, 0, 0.1] }\n'
COMMANDS = {
    "plan": (
        ("plan", "line.toml", "--machine", "hexapod", "--no-figures", "--out", "t/out"),
        "out",
        "out.kept",
    ),
    "dump": (("plan", "circle", "--dump-config", "t"), "machine.toml", "machine.kept.toml"),
    "init": (("init", "t"), "program.toml", "program.kept.toml"),
    "import": (("import", "part.nc", "--out", "t/out.toml"), "out.toml", "out.kept.toml"),
    "import, the figure": (
        ("import", "part.nc", "--out", "t/out.toml", "--figure", "t/out.png"),
        "out.png",
        "out.kept.png",
    ),
    "calibrate": (("calibrate", "hexapod", "cmm", "--out", "t/out"), "out", "out.kept"),
    "export": (
        ("export", "plan", "--format", "npz", "--out", "t/out.npz"),
        "out.npz",
        "out.kept.npz",
    ),
    "track": (("track", "plan", "--law", "3"), "../plan/track.json", "../plan/track.kept.json"),
    "view": (
        ("view", "plan", "--frames", "2", "--html", "t/out.html"),
        "out.html",
        "out.kept.html",
    ),
    "stills": (("view", "plan", "--stills", "t/out.svg"), "out.svg", "out.kept.svg"),
    "compare": (
        ("compare", "--law", "1", "--task", "line", "--out", "t"),
        "compare.json",
        "compare.kept.json",
    ),
    "positions": (("positions", "poses.csv", "save", "t/out.csv"), "out.csv", "out.kept.csv"),
}


@pytest.mark.parametrize(("arguments", "place", "kept"), COMMANDS.values(), ids=COMMANDS)
def test_what_comes_meanwhile_stays(
    tmp_path, call, corner, directory, monkeypatch, arguments, place, kept
):
    there = tmp_path / "t"
    there.mkdir()
    shutil.copytree(directory if arguments[0] == "track" else corner, tmp_path / "plan")
    (tmp_path / "line.toml").write_text(LINE)
    (tmp_path / "part.nc").write_text("G21 G90\nG1 X5 F600\nX0\n")
    (tmp_path / "poses.csv").write_text("x [mm],y [mm],z [mm]\n0,0,25\n")
    monkeypatch.chdir(tmp_path)

    def come(target):
        if target == (there / place).resolve():
            target.write_text("thesis")
        return stage_directory(target)

    monkeypatch.setattr(kinematics.files.atomic_files, "stage_directory", come)
    monkeypatch.setattr(pulsepath.output.directory, "stage_directory", come)
    done = call(*arguments)
    assert done.exit_code == 2, done.stderr
    assert "put there by something else while this ran, and is left as it is" in done.stderr
    assert (there / place).read_text() == "thesis"
    assert (there / kept).exists()
    assert not list(there.glob(".*.staged"))


def fill(folder, text):
    (folder / "plan.json").write_text(f'{{"kind": "{KIND}", "text": "{text}"}}')


@pytest.mark.parametrize("come", ["file", "directory", "another plan", "into it", "changed"])
def test_force_replaces_what_was_there_alone(tmp_path, come):
    out = tmp_path / "out"
    out.mkdir()
    fill(out, "old")

    def replace():
        with replace_directory(out, force=True) as folder:
            fill(folder, "new")
            if come in ("into it", "changed"):
                (out / ("thesis" if come == "into it" else "plan.json")).write_text("thesis")
                return
            out.rename(tmp_path / "moved")
            if come == "file":
                out.write_text("thesis")
                return
            out.mkdir()
            fill(out, "another") if come == "another plan" else (out / "thesis").write_text(
                "thesis"
            )

    with pytest.raises(MotionError, match=r"is left as it is; the result is kept in .*out\.kept"):
        replace()
    assert "new" in (tmp_path / "out.kept" / "plan.json").read_text()
    assert [path.name for path in (tmp_path / "out.kept").iterdir()] == ["plan.json"]
    texts = [path.read_text() for path in ([out] if out.is_file() else out.iterdir())]
    assert any("thesis" in text or "another" in text for text in texts)
    assert len(texts) == (2 if come == "into it" else 1)
    assert {path.name for path in tmp_path.iterdir()} <= {"out", "out.kept", "moved"}


@pytest.mark.parametrize("force", [False, True])
def test_a_plan_that_another_run_finishes_meanwhile_stays(tmp_path, force):
    out = tmp_path / "out"

    def run():
        with replace_directory(out, force=force) as folder:
            fill(folder, "new")
            out.mkdir()
            fill(out, "another")

    with pytest.raises(MotionError, match=r"put there by something else .* kept in .*out\.kept"):
        run()
    assert "another" in (out / "plan.json").read_text()
    assert "new" in (tmp_path / "out.kept" / "plan.json").read_text()
    assert {path.name for path in tmp_path.iterdir()} == {"out", "out.kept"}


@pytest.mark.parametrize("way", ["--stream", "--whole"])
@pytest.mark.parametrize("when", ["reading", "planning"])
@pytest.mark.parametrize("come", ["file", "plan"])
def test_plan_with_force_leaves_what_comes_while_it_runs(
    tmp_path, call, monkeypatch, way, when, come
):
    out, line = tmp_path / "out", tmp_path / "line.toml"
    line.write_text(LINE)
    asked = (
        "plan",
        line,
        "--machine",
        "hexapod",
        "--no-figures",
        "--no-baselines",
        "--order",
        "2",
        "--force",
        way,
    )
    assert call(*asked, "--out", out).exit_code == 0

    def interfere(do):
        def work(*given, **named):
            if come == "file":
                (out / "thesis.txt").write_text("mine")
            else:
                shutil.rmtree(out)
                out.mkdir()
                fill(out, "another")
            return do(*given, **named)

        return work

    module, name = {
        "reading": (InputRequest, "read"),
        "planning": (pulsepath.parts_job, "make_parts")
        if way == "--stream"
        else (pulsepath.job, "make_plan"),
    }[when]
    monkeypatch.setattr(module, name, interfere(getattr(module, name)))
    done = call(*asked, "--out", out)
    assert done.exit_code == 2, done.stderr
    assert (
        "was changed or replaced while this ran, and is left as it is; the result is kept in"
        in done.stderr
    )
    left = out / ("thesis.txt" if come == "file" else "plan.json")
    assert left.read_text() == "mine" if come == "file" else "another" in left.read_text()
    assert (tmp_path / "out.kept" / "motion.bin").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"out", "out.kept", "line.toml"}


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (("hold", "plan", "--at", "40 %", "--format", "npz", "--out", "a.npz"), ["a.npz"]),
        (
            (
                "hold",
                "plan",
                "--at",
                "40 %",
                "--format",
                "npz",
                "--out",
                "a.npz",
                "--resume",
                "b.npz",
            ),
            ["b.npz"],
        ),
        (("hold", "plan", "--stops", "1", "--out", "a.csv"), ["a.csv"]),
    ],
    ids=["stop", "way on", "table"],
)
def test_sections_replace_no_file_that_comes_while_they_are_made(
    tmp_path, call, corner, monkeypatch, arguments, names
):
    shutil.copytree(corner, tmp_path / "plan")
    monkeypatch.chdir(tmp_path)

    def come(*given):
        for name in names:
            (tmp_path / name).write_text("thesis")
        return read_whole(*given)

    read_whole = pulsepath.sections.read_whole
    monkeypatch.setattr(pulsepath.sections, "read_whole", come)
    done = call(*arguments, "--force")
    assert done.exit_code == 2, done.stdout
    assert "was put there by something else while this ran, and is left as it is" in done.stderr
    for name in names:
        assert (tmp_path / name).read_text() == "thesis"
