"""The exported call list on the virtual cards, there and back: `python -m benchmarks.evidence.trials.card_replay`,
half a minute.

The program `circle` on the hexapod: path -> calls of a PCI-8132 and a PCI-8164 -> the virtual cards -> pulses -> poses
by forward kinematics -> path, with the calls as they are exported by default, and 16, 4 and 2 ms apart. Of each it
prints a row: the worst axis in pulses, ½ of which is the rounding of positions to counts, and the platform's origin in
micrometres, from where it was planned to be at that instant, and from the path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from controllers.card.model import PCI_8132, PCI_8164, Card, Refused
from controllers.card.record import Train, play
from controllers.card.state import at_rest
from controllers.card.trapezoid import TAMove
from controllers.metrics.contour import PathCurve, contour_error
from kinematics import load_machine
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from planner import load_program, plan
from planner.export.card_calls import SPEED_HEADROOM, Call, wired_counts
from planner.export.format import ExportSource, refuse_compensated
from planner.export.formats.adlink import AdlinkCsv, read_calls
from planner.path.actuation import MachinePath

CARDS: Mapping[str, Card] = {"_8132_ta_move": PCI_8132, "_8164_start_ta_move": PCI_8164}
"""The card behind each function of the call list."""
SETTLING_TIME = 0.1
"""s after the last call's ramp at which the counts are final."""


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """What the cards fired: for each axis its card, the count of its wiring before the first call, and its pulses."""

    cards: tuple[Card, ...]
    starts: tuple[int, ...]
    trains: tuple[Train, ...]

    def counts(self, t: Array) -> np.ndarray:
        """Counts (N, axes) of the wiring at instants t (N,), s, int64: pulses counted up to each instant."""
        columns = []
        for card, start, train in zip(self.cards, self.starts, self.trains, strict=True):
            fired = np.searchsorted(train.ticks, t * card.clock_hz, side="right")
            columns.append(np.concatenate([[start], train.count])[fired])
        return np.stack(columns, -1)


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """How far the replayed motion is from the planned one, at the same instants.

    pulses        of the worst axis; next to its pulses, and at instants between
    displacement  m, of the platform's origin, by forward kinematics of the counts
    path          m, from the path, whatever the time: the contour error
    counts        pulses (axes,), final counts less planned ones
    calls         number of them
    """

    pulses: float
    displacement: float
    path: float
    counts: np.ndarray
    calls: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", freeze_array(self.counts, np.int64))


def replay(
    source: ExportSource, calls: Sequence[Call], speed_ranges: Sequence[float] | None = None, **options: Any
) -> ReplayResult:
    """The calls on a card of each axis' kind, set to `options` (fields of `Card`).

    speed_ranges  (axes,) pulses/s, what the host sets the speed registers to; None: just above the axis' fastest call,
                  as the call list chooses them by itself
    Raises Refused, with the card's reason, for a call that it does not take or has no function for.
    """
    cards, starts, trains = [], [], []
    until = max([source.trajectory.duration, *(call.time + call.tacc for call in calls)]) + SETTLING_TIME
    for k, (axis, pulses) in enumerate(zip(source.machine.axes, source.pulses.axes, strict=True)):
        own = [call for call in calls if call.name == axis.name]
        functions = {call.function for call in own}
        for function in functions - set(CARDS):
            raise Refused(f"replay: axis {axis.name}: no card has {function!r}; known are {', '.join(CARDS)}")
        model = CARDS[functions.pop()] if functions else PCI_8132
        fastest = max((max(call.start, call.top) for call in own), default=1.0) * SPEED_HEADROOM
        top = min(max(fastest, 1.0), model.max_speed) if speed_ranges is None else speed_ranges[k]
        card = replace(model, speed_range=top, **options)
        start = pulses.start * axis.direction
        sent = ((call.time, _command(call)) for call in own)
        cards.append(card)
        starts.append(start)
        trains.append(play(card, at_rest([start]), sent, until).train(0))
    return ReplayResult(tuple(cards), tuple(starts), tuple(trains))


def _command(call: Call) -> TAMove:
    position, start, top = (np.array([value]) for value in (call.position, call.start, call.top))
    return TAMove(position, start, top, call.tacc, call.tdec)


def round_trip(source: ExportSource, calls: Sequence[Call], replayed: ReplayResult, instants: int = 2000) -> RoundTrip:
    """How far the cards' pulses are from the plan. Raises MotionError for axes that compensate, and without poses.

    Pulses: |count − planned| just before and just after every pulse, and at so many instants, evenly spaced. Poses, at
    these instants: forward kinematics of q = home + direction · pulse · count, near the planned pose.
    """
    refuse_compensated(source, "replay")
    machine, trajectory = source.machine, source.trajectory
    t = np.linspace(0.0, trajectory.duration, instants)
    state, path = trajectory.at(t), trajectory.path
    if state.pose is None or not isinstance(path, MachinePath):
        raise MotionError(f"replay: the motion {source.name!r} has no poses; plan a program on machine {machine.name}")
    counts, worst = replayed.counts(t), 0.0
    for k, (card, start, train) in enumerate(zip(replayed.cards, replayed.starts, replayed.trains, strict=True)):
        at = np.minimum(train.ticks / card.clock_hz, trajectory.duration)
        after = np.concatenate([[start], train.count])
        edges = np.stack([after[:-1], after[1:]]) - wired_counts(source, k, at)[0]
        between = counts[:, k] - wired_counts(source, k, t)[0]
        worst = max(worst, np.abs(edges).max(initial=0.0), np.abs(between).max())
    scale = np.array([axis.direction * axis.pulse for axis in machine.axes])
    # the proof is left out: a pulse beside the planned pose there is no other
    y = machine.forward(machine.home_q + scale * counts, near=state.pose, certify=False).pose.translation
    off = np.linalg.norm(y - state.pose.translation, axis=1)
    near = contour_error(y, state.s, PathCurve(path)).error
    final = replayed.counts(np.array([np.inf]))[0]
    planned = np.array([p.final * a.direction for p, a in zip(source.pulses.axes, machine.axes, strict=True)])
    return RoundTrip(float(worst), float(off.max()), float(near.max()), final - planned, len(calls))


SPACINGS = (None, 16e-3, 4e-3, 2e-3)


def main() -> None:
    """Print a row for each spacing of the calls."""
    machine = load_machine("hexapod")
    made = plan(load_program("circle"), machine)
    source = ExportSource("circle", machine, made.trajectory, made.pulses)
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
