"""`python -m pulsepath`: the command line."""

import gc
import signal

from pulsepath.process.supervisor import supervise

GC_THRESHOLDS = 50_000, 20, 100
"""New objects until the youngest, the younger and all are looked through. Python's own numbers have a process that
loads much and ends soon look through all of it again and again, for a tenth of its time."""


def main() -> None:
    """Run the command line. Ctrl-C before the commands have loaded, or after their end, exits silently."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored, and stays so
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    supervise()
    gc.set_threshold(*GC_THRESHOLDS)
    from pulsepath.cli import main

    main(prog_name="pulsepath")


if __name__ == "__main__":
    main()
