"""`python -m pulsepath`: the command line."""

import gc
import os
import signal
import sys

from pulsepath.process import ending

# New objects until the youngest, the younger and all are searched for garbage. With Python's own
# numbers, a process that loads much and ends soon spends a tenth of its time on it.
GC_THRESHOLDS = 50_000, 20, 100


def main() -> None:
    """Run the command line. Ctrl-C before a command begins exits silently."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it stays ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    _reopen_closed_streams()
    ending.watch()
    gc.set_threshold(*GC_THRESHOLDS)
    from pulsepath.cli import main

    try:
        main(prog_name="pulsepath")
    finally:
        ending.leave()
        # As it ends, Python searches all objects for garbage, several times. This takes as long as
        # a third of the imports, and the memory is returned anyway.
        gc.freeze()


def _reopen_closed_streams() -> None:
    """Open /dev/null for streams that a shell closed, as by >&-: no other file may replace them."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115, PTH123  # to the end
            setattr(sys, name, stream)


if __name__ == "__main__":
    main()
