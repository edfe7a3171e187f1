"""The exported call list on the virtual cards, there and back: `python -m benchmarks.card_replay`, half a minute.

The program `circle` on the hexapod: path -> calls of a PCI-8132 and a PCI-8164 -> the virtual cards -> pulses -> poses
by forward kinematics -> path, with the calls as they are exported by default, and 16, 4 and 2 ms apart. Of each it
prints a row: the worst axis in pulses, ½ of which is the rounding of positions to counts, and the platform's origin in
micrometres, from where it was planned to be at that instant, and from the path.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from controllers.card.replay import replay, round_trip
from kinematics import load_machine
from planner import load_program, plan
from planner.export.adlink_csv import AdlinkCsv, read_calls
from planner.export.format import Source

SPACINGS = (None, 16e-3, 4e-3, 2e-3)


def main() -> None:
    """Print a row for each spacing of the calls."""
    machine = load_machine("hexapod")
    made = plan(load_program("circle"), machine)
    source = Source("circle", machine, made.trajectory, made.pulses)
    print("spacing ms  calls  while moving  error pulses  displacement um  path um  final counts")
    for spacing in SPACINGS:
        with TemporaryDirectory() as folder:
            file = Path(folder) / "calls.csv"
            AdlinkCsv(spacing).write(source, file)
            calls = read_calls(file)
        for mode in ("replace", "queue"):
            found = round_trip(source, calls, replay(source, calls, while_moving=mode))
            exact = "exact" if not found.counts.any() else f"off by {abs(found.counts).max()}"
            print(
                f"{'default' if spacing is None else f'{spacing * 1e3:g}':>10s}  {found.calls:5d}  {mode:>12s}"
                f"  {found.pulses:12.3f}  {found.displacement * 1e6:15.2f}  {found.path * 1e6:7.2f}  {exact}",
                flush=True,
            )


if __name__ == "__main__":
    main()
