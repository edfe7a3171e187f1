"""The command line in two processes: a worker, and a supervisor that ensures that a signal always ends it.

Python runs the handler of a signal between two of its own instructions. While a foreign library computes, as CasADi may
for many minutes, there are none, and some libraries swallow what a handler raises. So the first process, which loads
nothing, is told of signals (its own, and by the wakeup descriptor [signal.set_wakeup_fd] of those of the worker),
passes them on, gives the worker GRACE_PERIOD to end in good order, and then ends it and what it started, and clears up
after it.

Only `pulsepath` as a program does so: whoever calls its functions has one process, and his own signals.
"""

import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that end a command in good order, of which a system may not know all."""
GRACE_PERIOD = 1.2
"""s that the worker has to end in good order, of the 2 s within which a signal ends a command."""
SAME_SIGNAL_TIME = 0.05
"""s within which a signal to all of a group, as a terminal's Ctrl-C, has reached the worker as well."""
MAX_READ_BYTES = 1 << 16

_tell: int | None = None
"""File descriptor of the worker's messages to the supervisor: lines of JSON, and signals as single bytes."""


def supervise() -> None:
    """Go on in a worker; the first process never returns. Without processes that fork, go on as before."""
    threading = sys.modules.get("threading")
    if not hasattr(os, "fork") or (threading is not None and threading.active_count() > 1):
        return
    told, tell = _pipe()
    first, worker = os.getpid(), os.fork()
    if worker:
        os.close(tell)
        os._exit(_watch(worker, told))
    os.close(told)
    _end_with_parent(first)
    global _tell
    _tell = tell
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)


def tell(**what: Any) -> None:
    """Send a message to the supervisor, if there is one: files to be written, or time for an orderly end.

    code: exit code, sent when all is done; the rest is Python's own end, which may take long on a busy
    computer.
    """
    if _tell is not None:
        import json

        with suppress(OSError):  # it is no more, or has not read for long: it can do without
            os.write(_tell, f"{json.dumps(what)}\n".encode())


def leave(code: int) -> None:
    """End the worker at once while its compiler runs, which cannot bear the end of the interpreter.

    Exit handlers run first. Without a supervisor the command continues as before.
    """
    kernels = sys.modules.get("kinematics.foundation.kernels")
    if _tell is None or kernels is None or not kernels.is_compiling():
        return
    import atexit

    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(code)


def _pipe() -> tuple[int, int]:
    """Open a pipe apart from the standard streams, which may be closed. Writing to it never blocks."""
    import fcntl

    ends = os.pipe()
    read, write = (fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 3) for end in ends)
    for end in ends:
        os.close(end)
    os.set_blocking(write, False)
    return read, write


def _end_with_parent(first: int) -> None:
    """Have the worker ended with the first process, even where that is killed."""
    if sys.platform == "linux":
        import ctypes

        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
    else:
        from threading import Thread

        def wait() -> None:
            while os.getppid() == first:
                time.sleep(0.5)
            os.kill(os.getpid(), signal.SIGKILL)

        Thread(target=wait, daemon=True).start()
    if os.getppid() != first:
        os._exit(1)


class _Watch:
    """The supervisor's knowledge of the worker: the signal that ends it, its deadline, and its messages."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.asked: int | None = None
        self.deadline = float("inf")
        self.forward: dict[int, float] = {}
        self.reached: dict[int, float] = {}
        self.told: dict[str, Any] = {}
        self._line = b""

    def come(self, number: int) -> None:
        """A signal to this process: given on, unless it reaches the worker as well."""
        now = self._clock()
        self._ask(number, now)
        if now - self.reached.get(number, -1.0) > 2 * SAME_SIGNAL_TIME:
            self.forward.setdefault(number, now + SAME_SIGNAL_TIME)

    def read(self, content: bytes) -> None:
        """Return the messages of the worker, and the signals that reached it."""
        for byte in content:
            if byte in _numbers():
                now = self._clock()
                self._ask(byte, now)
                self.reached[byte] = now
                self.forward.pop(byte, None)
            elif byte == ord("\n"):
                self._take(self._line)
                self._line = b""
            else:
                self._line += bytes([byte])

    def _ask(self, number: int, now: float) -> None:
        if self.asked is None:
            self.asked = number
            self.deadline = now + GRACE_PERIOD * self.told.get("patience", 1.0)

    def _take(self, line: bytes) -> None:
        import json

        try:
            self.told |= json.loads(line)
        except ValueError:
            return
        if self.asked is not None and "patience" in self.told:
            self.deadline = self._clock() + GRACE_PERIOD * self.told["patience"]


def _numbers() -> frozenset[int]:
    return frozenset(int(getattr(signal, name)) for name in SIGNAL_NAMES if hasattr(signal, name))


def _watch(worker: int, told: int) -> int:
    """The exit code of the worker. Ends this process by a signal where that ended the worker."""
    mode = _terminal_mode()
    come, came = _pipe()
    signal.set_wakeup_fd(came, warn_on_full_buffer=False)
    for number in (*_numbers(), signal.SIGCHLD):
        if signal.getsignal(number) is not signal.SIG_IGN or number == signal.SIGCHLD:
            signal.signal(number, lambda *_: None)
    watch, sources = _Watch(), [come, told]
    while True:
        ended, status = os.waitpid(worker, os.WNOHANG)
        if ended:
            break
        now = time.monotonic()
        if now >= watch.deadline:
            _kill(worker)
            _, status = os.waitpid(worker, 0)
            for byte in _read_rest(told):
                watch.read(bytes([byte]))
            return _clear_up(worker, watch, mode)
        for number in [number for number, at in watch.forward.items() if at <= now]:
            del watch.forward[number]
            os.kill(worker, number)
        until = min([watch.deadline, *watch.forward.values()])
        ready, _, _ = select.select(sources, [], [], None if until == float("inf") else max(0.0, until - now))
        if come in ready:
            for number in os.read(come, MAX_READ_BYTES):
                if number in _numbers():
                    watch.come(number)
        if told in ready:
            content = os.read(told, MAX_READ_BYTES)
            watch.read(content)
            if not content:
                sources.remove(told)
    if not os.WIFSIGNALED(status):
        return os.waitstatus_to_exitcode(status)
    for byte in _read_rest(told):
        watch.read(bytes([byte]))
    _remove_leftovers(worker, watch, mode)
    signal.set_wakeup_fd(-1)
    number = os.WTERMSIG(status)
    if number != signal.SIGKILL:
        signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    return 128 + number


def _read_rest(told: int) -> Iterator[int]:
    """Read the last messages of a worker that has ended."""
    os.set_blocking(told, False)
    try:
        while content := os.read(told, MAX_READ_BYTES):
            yield from content
    except BlockingIOError:  # something that it started holds the other end
        return


def _clear_up(worker: int, watch: _Watch, mode: list[Any] | None) -> int:
    """Restore terminal and folders after a worker was killed, and print a message."""
    _remove_leftovers(worker, watch, mode)
    from pulsepath.process.exits import of_interruption
    from pulsepath.process.load_alone import load_alone

    with suppress(OSError):  # where nobody looks any more
        if os.isatty(2):
            os.write(2, b"\r\x1b[K\x1b[?25h")  # the line of progress, and the cursor that was hidden over it
        if not watch.told.get("said"):
            messages = load_alone("plain_text").plain(of_interruption(watch.told))
            os.write(2, f"{messages}\n".encode(errors="replace"))
    return int(watch.told.get("code", 128 + (watch.asked or signal.SIGINT)))


def _remove_leftovers(worker: int, watch: _Watch, mode: list[Any] | None) -> None:
    """Remove the files of a killed worker: shared memory of its processes, unfinished results, new folders.

    planner.parallel names the first by the worker's number, and so does loky.
    """
    if mode is not None:
        import termios

        signal.signal(signal.SIGTTOU, signal.SIG_IGN)
        with suppress(termios.error):
            termios.tcsetattr(0, termios.TCSANOW, mode)
    from pathlib import Path
    from shutil import rmtree
    from tempfile import gettempdir

    for folder in Path(gettempdir()).glob(f"pulsepath-{worker}-*"):
        rmtree(folder, ignore_errors=True)
    for semaphore in Path("/dev/shm").glob(f"sem.loky-{worker}-*"):
        semaphore.unlink(missing_ok=True)
    if not watch.told.get("folders"):
        return
    from pulsepath.process.load_alone import load_alone

    clear = load_alone("leftovers").clear
    for folder in watch.told["folders"]:
        with suppress(OSError):  # the next run tries again
            clear(Path(folder))
    for folder in watch.told.get("made", ()):
        with suppress(OSError):  # it is not empty, or was never made
            Path(folder).rmdir()


def _kill(worker: int) -> None:
    """End the worker and all processes of its group. A browser, for example, has left the group."""
    os.kill(worker, signal.SIGSTOP)  # so that it starts nothing more
    group, parents = os.getpgrp(), _parents()
    paths, below = [worker], {worker}
    while below:
        below = {child for child, parent in parents.items() if parent in below}
        paths += below
    for each in paths:
        try:
            if os.getpgid(each) == group:
                os.kill(each, signal.SIGKILL)
        except ProcessLookupError:
            pass


def _parents() -> dict[int, int]:
    """The parent of every process."""
    from pathlib import Path

    if sys.platform == "linux":
        paths = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    stat = (entry / "stat").read_bytes()
                except OSError:
                    continue
                paths[int(entry.name)] = int(stat.rpartition(b")")[2].split()[1])  # a name may have any letters
        return paths
    from subprocess import run

    lines = run(["/bin/ps", "-A", "-o", "pid=,ppid="], capture_output=True, check=False).stdout.splitlines()
    return {int(pid): int(parent) for pid, parent in map(bytes.split, lines)}


def _terminal_mode() -> list[Any] | None:
    """Return the settings of the terminal, if there is one: a killed console leaves it raw."""
    if not os.isatty(0):
        return None
    import termios

    try:
        return termios.tcgetattr(0)
    except termios.error:
        return None
