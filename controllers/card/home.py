"""Home return: the counter's zero is brought to a switch or the index behind it; numbered modes of
the PCI-8164.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from controllers.card.channels import Channels, Command, broadcast_lanes
from controllers.card.model import Refused
from controllers.card.profile import MoveProfile, standstill
from controllers.card.trapezoid import lock_move, trapezoid
from kinematics.foundation.arrays import Array


@dataclass(frozen=True, slots=True)
class HomeReturn(Command):
    """Home return, one value per lane: approach, stop, back off, latch zero.

    1. approach  in `direction`, from `start_speed` up to `speed` within `tacc`, until the switch
                 closes;
    2. stop      down to the start speed at the same rate, at once then, beyond the switch;
    3. back off  at `creep` until the switch opens, and on to the first index pulse from there
                 (where it opens, if there is one);
    4. zero      there it stops dead, and the counter is set to 0.

    The cards' documents name the switch, the index and thirteen modes, not their steps: this is one
    of our own, for any card; `HomeMode` has the numbered ones as they are remembered. Assumed: a
    switch that stays closed beyond its edge, and no delay between the steps. A channel that begins
    on the switch skips 1 and 2. Takes no change on the fly; soft limits do not hold.

    switch     (…) whole pulses by the coordinates of power-up (`MoveProfile.zero`), where the
               switch closes
    direction  (…) +1 or −1, where it lies
    start_speed, speed, creep  (…) pulses/s
    tacc       s
    index, index_spacing  whole pulses by the same coordinates, of one index pulse, and between two;
                          None: no index
    """

    switch: Array
    direction: Array
    start_speed: Array
    speed: Array
    creep: Array
    tacc: float
    index: Array | None = None
    index_spacing: int | None = None

    def __post_init__(self) -> None:
        names = ("switch", "direction", "start_speed", "speed", "creep")
        broadcast_lanes(self, *names, *(("index",) if self.index is not None else ()))

    @property
    def has_soft_limits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        if (self.index is None) != (self.index_spacing is None) or (self.index_spacing or 1) < 1:
            raise Refused(
                f"{now.card.name}: home return: an index needs a spacing of whole pulses above zero, not "
                f"{self.index_spacing}"
            )
        sign, (v0, v1, creep), tacc, zero = _read_search(self, now)
        edge = now.target(np.rint(self.switch) - zero)
        behind = np.zeros(now.due.shape)
        if self.index is not None and self.index_spacing is not None:
            behind = np.mod((np.rint(self.switch) - np.rint(self.index)) * sign, self.index_spacing)
        out = approach(now, (edge - now.position) * sign, sign, v0, v1, tacc)
        place = edge - sign * behind
        back = trapezoid(out.end, out.target, place, creep, creep, 0.0, 0.0)
        there = replace(standstill(np.zeros(now.due.shape)), begin=back.end, zero=zero + place)
        return (*(replace(lock_move(move), zero=zero) for move in (out, back)), there)


def _read_search(
    command: HomeReturn | HomeMode, now: Channels
) -> tuple[Array, tuple[Array, Array, Array], float, Array]:
    """Direction, speeds (start, search, creep), time of the ramp, and where the zero lies now, of a
    home return.
    """
    sign = np.broadcast_to(command.direction, now.due.shape)
    now.forbid(np.abs(sign) != 1, "home return: direction must be +1 or −1")
    v0, v1, creep = (
        now.magnitude(what, speed)
        for what, speed in (
            ("start speed", command.start_speed),
            ("speed", command.speed),
            ("creep", command.creep),
        )
    )
    zero = np.zeros(now.due.shape) if now.running.zero is None else now.running.zero
    return sign, (v0, v1, creep), now.ramp("acceleration", command.tacc), zero


def approach(
    now: Channels,
    distance: Array,
    sign: Array,
    v0: Array,
    v1: Array,
    tacc: float,
    *,
    dead: bool = False,
) -> MoveProfile:
    """Up to a switch, and beyond it down to the start speed, or `dead` on it; nothing in lanes that
    are on it.
    """
    open_ = distance > 0
    way = np.where(open_, distance, 0.0)
    rate = (v1 - v0) / (tacc or 1.0)
    short = way < (v0 + v1) / 2 * tacc
    top = np.where(short, np.sqrt(np.maximum(v0 * v0 + 2 * way * rate, 0.0)), v1)
    up = np.where(short, 2 * way / (v0 + top), tacc)
    held = np.where(short, 0.0, (way - (v0 + v1) / 2 * tacc) / v1)
    down = np.where(open_ & (not dead), up, 0.0)
    lengths = np.stack((np.where(open_, up, 0.0), np.where(open_, held, 0.0), down))
    speeds, rates = (
        np.stack((v0, top, top)) * sign,
        np.stack((rate, np.zeros_like(rate), -rate)) * sign,
    )
    target = now.position + sign * (way + np.where(open_, (v0 + top) / 2 * down, 0.0))
    return MoveProfile(now.begin, now.position, target, lengths, speeds, rates)


Sensor = Literal["origin", "limit"]
FollowUp = Literal["stop", "edge", "creep on", "run on", "creep back", "run back"]


@dataclass(frozen=True, slots=True)
class Mode:
    """What a numbered mode does when its first sensor closes.

    sensor   the origin switch, or the end limit, at which the channel stops dead and which it
             leaves again
    then     "stop": ramps down. "edge": ramps down, creeps back until the switch opens, and on to
             where it closes. "creep on": ramps down to the start speed and goes on to the index,
             "run on" goes on at speed; "creep back" and "run back" ramp down first and come to the
             index, or from a limit to its edge, on the way back. What creeps stops dead, what runs
             ramps down beyond the place of zero. Where "creep on" meets the index before it has
             ramped down, it stops dead at the speed that it has there
    index    whether zero is an index pulse
    returns  whether the channel runs back at last to the zero that it has passed
    """

    sensor: Sensor
    then: FollowUp
    index: bool = True
    returns: bool = False


MODES: Mapping[int, Mode] = {
    0: Mode("origin", "stop", index=False),
    1: Mode("origin", "edge", index=False),
    2: Mode("origin", "creep on"),
    3: Mode("origin", "run on"),
    4: Mode("origin", "creep back"),
    5: Mode("origin", "run back"),
    6: Mode("limit", "creep back", index=False),
    7: Mode("limit", "creep back"),
    8: Mode("limit", "run back"),
    9: Mode("origin", "stop", index=False, returns=True),
    10: Mode("origin", "run on", returns=True),
    11: Mode("origin", "run back", returns=True),
    12: Mode("limit", "run back", returns=True),
}
"""ASSUMPTION: the source says no more than that there are thirteen, with a home switch, an index
signal and end limits [Sahbaz 2007, Appendix A]. Their numbers and steps are those of the card's
manual as it is remembered; it is not here to be compared. Check a mode against the manual of the
card before it moves a machine.
"""


@dataclass(frozen=True, slots=True)
class HomeMode(Command):
    """Home return by a numbered mode, one value per lane: see `MODES` for what each does; the 8164
    has thirteen.

    The counter is zero where the mode says: where the origin switch closes, where the limit opens,
    or at the index pulse that is the `index_count`-th from there (from the turn on, where the index
    is looked for on the way back). A channel that ramps down beyond that place stands at the count
    of its way from it.

    ASSUMPTIONS: those of `MODES`; switches stay closed beyond their edges, and open one pulse
    before; the ramp down has the rate of the ramp up; a channel that begins on its switch skips the
    way to it. Refused where the ramp down would run into the limit that is stated. Takes no change
    on the fly; soft limits do not hold.

    mode       0 … 12
    direction  (…) +1 or −1, towards the switch
    start_speed, speed, creep  (…) pulses/s
    tacc       s
    origin, limit  (…) whole pulses by the coordinates of power-up (`MoveProfile.zero`), where each
                   closes; None: none
    index, index_spacing  whole pulses by the same coordinates, of one index pulse, and between two;
                          None: no index
    index_count    how many index pulses are counted
    """

    mode: int
    direction: Array
    start_speed: Array
    speed: Array
    creep: Array
    tacc: float
    origin: Array | None = None
    limit: Array | None = None
    index: Array | None = None
    index_spacing: int | None = None
    index_count: int = 1

    def __post_init__(self) -> None:
        given = [name for name in ("origin", "limit", "index") if getattr(self, name) is not None]
        broadcast_lanes(self, "direction", "start_speed", "speed", "creep", *given)

    @property
    def has_soft_limits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        mode = self._mode(now)
        sign, (v0, v1, creep), tacc, zero = _read_search(self, now)
        switch = self.origin if mode.sensor == "origin" else self.limit
        edge = now.target(np.rint(_place_or_zero(switch)) - zero)
        if mode.sensor == "limit":
            first = approach(now, (edge - now.position) * sign, sign, v0, v1, tacc, dead=True)
            moves, place = _back_off(
                now, self, mode, [first], edge - sign, zero, sign, (v0, v1, creep), tacc
            )
        else:
            moves, place = self._from_origin(now, mode, edge, zero, sign, (v0, v1, creep), tacc)
        if self.limit is not None and mode.sensor == "origin":
            end = np.rint(self.limit) - zero
            far = np.max([(move.target - end) * sign for move in moves], axis=0)
            now.forbid(
                far >= 0,
                "home return: the ramp down beyond the origin runs into the limit; search slower",
            )
        if mode.returns:
            last = moves[-1]
            moves.append(trapezoid(last.end, last.target, place, v0, v1, tacc, tacc))
        last = moves[-1]
        there = replace(standstill(last.target - place), begin=last.end, zero=zero + place)
        return (*(replace(lock_move(move), zero=zero) for move in moves), there)

    def _mode(self, now: Channels) -> Mode:
        """The mode.

        Raises Refused where the card does not have it, or what it needs is not stated.
        """
        if not now.card.home_modes:
            raise Refused(
                f"{now.card.name}: home return: no numbered modes are known of this card; use Home, or a PCI-8164"
            )
        if self.mode not in MODES:
            raise Refused(
                f"{now.card.name}: home return: no mode {self.mode}; modes are 0 … {max(MODES)}"
            )
        mode = MODES[self.mode]
        needed = (mode.sensor, *(("index", "index_spacing") if mode.index else ()))
        missing = [name for name in needed if getattr(self, name) is None]
        if missing:
            raise Refused(
                f"{now.card.name}: home return: mode {self.mode} needs {' and '.join(missing)}; state it"
            )
        if mode.index and not (self.index_count >= 1 and (self.index_spacing or 0) >= 1):
            raise Refused(
                f"{now.card.name}: home return: index count {self.index_count} and spacing {self.index_spacing} must "
                "be whole numbers above zero"
            )
        return mode

    def _from_origin(
        self,
        now: Channels,
        mode: Mode,
        edge: Array,
        zero: Array,
        sign: Array,
        speeds: tuple[Array, Array, Array],
        tacc: float,
    ) -> tuple[list[MoveProfile], Array]:
        """Moves, and the place of zero, of a mode that begins at the origin switch."""
        v0, v1, creep = speeds
        way = (edge - now.position) * sign
        if mode.then == "run on":
            place = self._index(np.where(way > 0, edge, np.rint(now.position)), zero, sign)
            return [approach(now, (place - now.position) * sign, sign, v0, v1, tacc)], place
        first = approach(now, way, sign, v0, v1, tacc)
        if mode.then == "stop":
            return [first], edge
        if mode.then == "edge":
            back = trapezoid(first.end, first.target, edge - sign, creep, creep, 0.0, 0.0)
            return [
                first,
                back,
                trapezoid(back.end, back.target, edge, creep, creep, 0.0, 0.0),
            ], edge
        if mode.then == "creep on":
            place = self._index(np.where(way > 0, edge, np.rint(now.position)), zero, sign)
            cut = _cut_at(first, (place - now.position) * sign)
            on = trapezoid(cut.end, cut.target, place, v0, v0, 0.0, 0.0)
            return [cut, on], place
        return _back_off(now, self, mode, [first], edge, zero, sign, speeds, tacc)

    def _index(self, since: Array, zero: Array, sign: Array) -> Array:
        """The `index_count`-th index pulse beyond a place (…), in a direction."""
        spacing = float(self.index_spacing or 1)
        start = (np.rint(_place_or_zero(self.index)) - zero) * sign
        passed = np.floor((since * sign - start) / spacing)
        return np.asarray(sign * (start + (passed + self.index_count) * spacing))


def _back_off(
    now: Channels,
    command: HomeMode,
    mode: Mode,
    before: list[MoveProfile],
    edge: Array,
    zero: Array,
    sign: Array,
    speeds: tuple[Array, Array, Array],
    tacc: float,
) -> tuple[list[MoveProfile], Array]:
    """Behind moves that end beyond a switch: back to its edge, or the index, at the creep speed or
    at the whole one.
    """
    v0, v1, creep = speeds
    here = before[-1].target
    place = command._index(np.rint(here), zero, -sign) if mode.index else edge
    if mode.then == "creep back":
        return [*before, trapezoid(before[-1].end, here, place, creep, creep, 0.0, 0.0)], place
    standing = replace(now, begin=before[-1].end, position=here, speed=np.zeros_like(here))
    return [*before, approach(standing, (here - place) * sign, -sign, v0, v1, tacc)], place


def _cut_at(move: MoveProfile, way: Array) -> MoveProfile:
    """A move that runs one way, ended after a way (…) where it would go further.

    Of a piece of speed v and rate a the way w takes τ = 2 w/(v + √(v² + 2 a w)).
    """
    rest, lengths = np.array(way), []
    for i, length in enumerate(move.lengths):
        whole = np.abs(move.way(i, length))
        v, a = np.abs(move.speeds[i]), move.rates[i] * np.sign(move.speeds[i])
        some = np.minimum(np.maximum(rest, 0.0), whole)
        down = v + np.sqrt(np.maximum(v * v + 2 * a * some, 0.0))
        lengths.append(np.where(some < whole, 2 * some / np.where(down > 0, down, 1.0), length))
        rest = rest - whole
    sign = np.sign(move.target - move.start)
    ends = np.abs(move.target - move.start) > way
    target = np.where(ends, move.start + sign * np.maximum(way, 0.0), move.target)
    return replace(move, lengths=np.stack(lengths), target=target)


def _place_or_zero(place: Array | None) -> Array:
    """A place that the mode needs, which `_mode` has seen to."""
    return np.zeros(1) if place is None else place
