"""A signal ends a command within two seconds whatever it does, in good order, and nothing that it started stays."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from pulsepath.process import supervisor
from pulsepath.process.exits import of_interruption

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="one process there: there is no fork")

PLAN = """
import sys, time
from pulsepath.process.supervisor import supervise
supervise()
import pulsepath.cli, pulsepath.job
def run(*_):
    print("computing", file=sys.stderr, flush=True)
    {work}
pulsepath.job.run = run
pulsepath.cli.main(["plan", "bare-circle", "--no-figures", "--out", "a/b/out"], prog_name="pulsepath")
"""
SHORT = """
import sys, time
from pulsepath.process.supervisor import supervise
supervise()
from pathlib import Path
from pulsepath.cli import main
from pulsepath.process.intent import writes
@main.command()
def compute():
    writes(Path("a/b/out"))
    print("computing", file=sys.stderr, flush=True)
    {work}
main(["compute"], prog_name="pulsepath")
"""
"""A command that loads next to nothing."""
CASADI = "import casadi; casadi.mtimes([casadi.SX.sym('A', 100, 100)] * 1000)"
WORK = {
    "one instruction takes an hour": "sum(range(10**12))",
    "an error is swallowed": """
    while True:
        try:
            time.sleep(100)
        except BaseException:
            pass
""",
}
CHILD = """
import pickle, time
from contextlib import ExitStack
from planner.parallel import open_pool
kept = ExitStack()
pool = kept.enter_context(open_pool(pickle.dumps(time.sleep), 1))
pool.submit(0).future.result()
pool.submit(100)
print("computing", file=sys.stderr, flush=True)
"""


def start(folder, work, script=SHORT, **more):
    process = subprocess.Popen(
        [sys.executable, "-c", script.format(work=work)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.getcwd()},  # noqa: PTH109
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **more,
    )
    for _ in range(1 + ("pool" in work)):
        assert process.stderr.readline() == "computing\n"
    time.sleep(0.5 if "casadi" in work else 0.1)
    return process


def end(process):
    """What it says until no process holds its streams any more, which none of the work would have let go by then."""
    return process.communicate(timeout=60)[1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_it_ends_while_casadi_builds(tmp_path, number):
    process = start(tmp_path, CASADI)
    process.send_signal(number)
    said = end(process)
    assert process.returncode == 128 + number
    assert said == "interrupted: nothing was written to a/b/out\n"


@pytest.mark.parametrize("work", WORK.values(), ids=WORK)
def test_it_ends_whatever_computes(tmp_path, work):
    process = start(tmp_path, work)
    process.send_signal(signal.SIGTERM)
    said = end(process)
    assert process.returncode == 143
    assert said == "interrupted: nothing was written to a/b/out\n"


def test_what_is_done_keeps_its_code_however_long_python_takes_to_end(tmp_path):
    done = """
    from pulsepath.process.supervisor import tell
    try:
        time.sleep(100)
    except KeyboardInterrupt:
        tell(said=True, code=0)
        sum(range(10**12))
"""
    process = start(tmp_path, done)
    process.send_signal(signal.SIGINT)
    assert (end(process), process.returncode) == ("", 0)


def test_a_plan_leaves_nothing_behind(tmp_path):
    process = start(tmp_path, CASADI, PLAN)
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] != []
    process.send_signal(signal.SIGTERM)
    said = end(process)
    assert process.returncode == 143
    assert said == "interrupted: nothing was written to a/b/out\n"
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_reaches_both_once(tmp_path):
    process = start(tmp_path, CASADI, start_new_session=True)
    os.killpg(process.pid, signal.SIGINT)
    said = end(process)
    assert (process.returncode, said.count("interrupted")) == (130, 1)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_process_is_left(tmp_path, number):
    """Its own workers are busy, and it is itself."""
    process = start(tmp_path, f"exec('''{CHILD}'''); {CASADI}")
    process.send_signal(number)
    end(process)  # the streams are closed when all are gone
    assert process.returncode == (143 if number == signal.SIGTERM else -number)


def test_a_worker_that_is_killed_is_cleared_up_after(tmp_path):
    made = (
        "from kinematics.files.atomic_files import stage_directory; p = Path('a/b/out').absolute(); "
        "p.parent.mkdir(parents=True)"
    )
    process = start(tmp_path, f"{made}; s = stage_directory(p); s.__enter__(); import os; os.kill(os.getpid(), 9)")
    end(process)
    assert process.returncode == -signal.SIGKILL
    assert list(tmp_path.iterdir()) == []


def test_what_ignores_hang_ups_goes_on(tmp_path):
    def ignore():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    process = start(tmp_path, "time.sleep(0.5); raise SystemExit(7)", preexec_fn=ignore)
    process.send_signal(signal.SIGHUP)
    end(process)
    assert process.returncode == 7


def test_the_watch_gives_on_what_did_not_come():
    watch = supervisor._Watch()
    watch.read(bytes([signal.SIGINT]))
    watch.come(signal.SIGINT)  # the worker has it from the terminal
    assert not watch.forward
    watch.come(signal.SIGTERM)
    assert set(watch.forward) == {signal.SIGTERM}
    assert watch.asked == signal.SIGINT


@pytest.mark.parametrize("heard", ["by itself", "by the worker"])
def test_the_worker_is_ended_within_two_seconds_and_later_where_it_asks_for_patience(heard):
    now = 100.0
    watch = supervisor._Watch(lambda: now)
    assert watch.deadline == float("inf")
    if heard == "by itself":
        watch.come(signal.SIGTERM)
    else:
        watch.read(bytes([signal.SIGTERM]))
    assert watch.deadline == now + supervisor.GRACE_PERIOD < now + 2
    now = 101.0
    watch.come(signal.SIGINT)  # the second asks for nothing more
    assert watch.deadline == 100 + supervisor.GRACE_PERIOD
    watch.read(b'{"patience": 50.0}\n')
    assert watch.deadline == now + 50 * supervisor.GRACE_PERIOD


def test_notes_and_signals_share_a_pipe():
    watch = supervisor._Watch()
    line = json.dumps({"writes": [["ü\x02\n", "/ü\x02\n", None]], "kept": ""}).encode() + b"\n"
    assert not supervisor._numbers() & set(line)
    watch.read(line[:9] + bytes([signal.SIGTERM]) + line[9:])
    assert watch.asked == signal.SIGTERM
    assert watch.told["writes"][0][0] == "ü\x02\n"
    assert "nothing was written" in of_interruption(watch.told)


def test_a_program_that_calls_it_has_one_process():
    done = subprocess.run(
        [sys.executable, "-c", "import os, signal\nfrom click.testing import CliRunner\n"
         "from pulsepath.cli import main\n"
         "before = signal.getsignal(signal.SIGTERM)\nassert CliRunner().invoke(main, ['laws']).exit_code == 0\n"
         "assert signal.getsignal(signal.SIGTERM) is before\nassert signal.set_wakeup_fd(-1) == -1\n"
         "try:\n    os.waitpid(-1, os.WNOHANG)\n    raise SystemExit(1)\nexcept ChildProcessError:\n    pass"],
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
