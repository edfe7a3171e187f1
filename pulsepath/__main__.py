"""`python -m pulsepath`: the command line."""

import signal

from pulsepath.process.supervisor import supervise


def main() -> None:
    """Run it. Before the commands have loaded, and after they are done, Ctrl-C ends the process and says nothing."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored, and stays so
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    supervise()
    from pulsepath.cli import main

    main(prog_name="pulsepath")


if __name__ == "__main__":
    main()
