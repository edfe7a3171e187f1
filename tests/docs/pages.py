"""Runs a page of docs/: what a reader would type and write, in order, in one directory, against
what the page shows.

- A fence whose first line is a comment that names a file ("# part.toml", "; part.nc") is that file;
  so is the file of a `literalinclude` of docs/examples or of presets.
- Any other ```python fence is run; all of a page share their names. A ```text fence right after it
  is what it prints.
- A ```console fence holds commands, each after "$ ", and what they print; a comment "# exit code 1"
  says how one ends. A command that shows nothing may print anything. One that ends with " &" runs
  until the page ends.
- Of a command that fails, errors are shown as well; how far it is, which goes to the standard
  error, never is.
- "..." stands for any text, and runs of spaces are alike, as in doctest.
"""

import contextlib
import doctest
import io
import os
import re
import runpy
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import pytest
from click.testing import CliRunner

DOCS = Path(__file__).parents[2] / "docs"
FENCE = re.compile(
    r"^(?P<ticks>`{3,})(?P<info>[^\n`]*)\n(?P<body>.*?)^(?P=ticks)[ ]*$", re.MULTILINE | re.DOTALL
)
FILE = re.compile(r"(?:#|;|//) (?P<name>[\w./-]+\.\w+)\n")
LOOSE = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
PROGRESS = re.compile(r"^.*(?:…|: [\d.]+ s)\n", re.MULTILINE)
EXIT = re.compile(r"\s+# exit code (\d)$")


@dataclass(frozen=True)
class Fence:
    """A fenced block: its language, text and line, and whether only blank lines part it from the
    last.
    """

    language: str
    body: str
    line: int
    adjacent: bool


def fences(text: str) -> list[Fence]:
    found, end = [], 0
    for match in FENCE.finditer(text):
        gap = text[end : match.start()]
        found.append(
            Fence(
                match["info"].strip(),
                match["body"],
                text.count("\n", 0, match.start()) + 1,
                not gap.strip(),
            )
        )
        end = match.end()
    return found


def run(page: Path) -> int:
    """Run a page in the current directory; how many blocks were run or written.

    Raises AssertionError where it lies.
    """
    with contextlib.ExitStack() as background:
        return run_blocks(page, background)


def run_blocks(page: Path, background: contextlib.ExitStack) -> int:
    names: dict[str, Any] = {"__name__": "page"}
    blocks, count = fences(page.read_text(encoding="utf-8")), 0
    for fence, after in zip(blocks, [*blocks[1:], None], strict=True):
        where = f"{page.name}:{fence.line}"
        named = FILE.match(fence.body)
        if fence.language.startswith("{literalinclude}"):
            source = page.parent / fence.language.split()[1]
            if {"examples", "presets"} & set(source.parts):
                Path(source.name).write_bytes(source.read_bytes())
        elif named:
            Path(named["name"]).write_text(fence.body, encoding="utf-8")
        elif fence.language == "python":
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(fence.body, where, "exec"), names)  # noqa: S102 (the text is our own)
            if after is not None and after.language == "text" and after.adjacent:
                agree(where, after.body, printed.getvalue())
        elif fence.language == "console":
            console(where, fence.body, background)
        else:
            continue
        count += 1
    return count


def console(where: str, text: str, background: contextlib.ExitStack) -> None:
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        command, _, shown = part.partition("\n")
        told = EXIT.search(command)
        words = shlex.split(EXIT.sub("", command), comments=True)
        if words[-1] == "&":
            silent = subprocess.DEVNULL
            process = background.enter_context(
                subprocess.Popen(
                    find_program(words[:-1]), stdout=silent, stderr=silent, env=environment()
                )
            )
            background.callback(process.terminate)
            continue
        code, printed, complained = call(words)
        assert code == (int(told[1]) if told else 0), (
            f"{where}: {command}\nended with {code}\n{printed}{complained}"
        )
        if shown.strip():
            agree(f"{where}: {command}", shown, printed + complained if code else printed)


def call(words: list[str]) -> tuple[int, str, str]:
    """Exit code and what is printed by a command; without a process of its own, if it is Python."""
    if words[0] == "printf" and words[2:4] == ["|", "pulsepath"]:
        text, tolerated = words[1].encode().decode("unicode_escape"), words[-2:] == ["||", "true"]
        code, *output = piped(text, words[4:-2] if tolerated else words[4:])
        return (0 if tolerated else code, *output)
    if words[0] == "pulsepath":
        return pulsepath(words)
    is_script = words[0] == "python" and words[1].endswith(".py")
    return script(words[1:]) if is_script else other(words)


def pulsepath(words: list[str]) -> tuple[int, str, str]:
    from pulsepath.cli import main

    done = CliRunner().invoke(main, words[1:], prog_name="pulsepath")
    return done.exit_code, done.stdout, PROGRESS.sub("", done.stderr)


def piped(text: str, words: list[str]) -> tuple[int, str, str]:
    """Run the command with a text as its standard input; both ends are files, as a console asks
    for.
    """
    from pulsepath.cli import main

    complained, code = io.StringIO(), 0
    with TemporaryFile("w+") as typed, TemporaryFile("w+") as printed:
        typed.write(text)
        typed.seek(0)
        with (
            pytest.MonkeyPatch.context() as patch,
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(complained),
        ):
            patch.setattr(sys, "stdin", typed)
            try:
                main(words, prog_name="pulsepath")
            except SystemExit as ended:
                code = int(ended.code or 0)
        printed.seek(0)
        return code, printed.read(), complained.getvalue()


def script(words: list[str]) -> tuple[int, str, str]:
    """Run a file of Python as `python FILE ...` does, but for a process: starting one takes a
    second.
    """
    printed, complained, code = io.StringIO(), io.StringIO(), 0
    before = sys.argv
    sys.argv = words
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(complained):
            runpy.run_path(words[0], run_name="__main__")
    except SystemExit as ended:
        if isinstance(ended.code, str):
            complained.write(f"{ended.code}\n")
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    finally:
        sys.argv = before
    return code, printed.getvalue(), complained.getvalue()


def other(words: list[str]) -> tuple[int, str, str]:
    done = subprocess.run(
        find_program(words), capture_output=True, text=True, encoding="utf-8", env=environment()
    )
    return done.returncode, done.stdout, done.stderr


def find_program(words: list[str]) -> list[str]:
    """A shell's "python" is ours, and so is what was installed with it."""
    beside = Path(sys.executable).with_name(words[0])
    return [str(beside) if beside.exists() else words[0], *words[1:]]


def environment() -> dict[str, str]:
    searched = [str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)]
    return os.environ | {"PYTHONPATH": str(DOCS.parent), "PATH": os.pathsep.join(searched)}


def agree(where: str, wanted: str, got: str) -> None:
    if not doctest.OutputChecker().check_output(wanted, got, LOOSE):
        raise AssertionError(f"{where}\nthe page shows\n{wanted}\nand there is\n{got}")
