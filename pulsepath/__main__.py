"""`python -m pulsepath`: the command line."""

from pulsepath.cli import main

main(prog_name="pulsepath")
