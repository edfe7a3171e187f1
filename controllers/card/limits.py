"""Soft limits: commands that would pass one are refused, or stop there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from controllers.card.channels import Channels
from controllers.card.lanes import cut
from controllers.card.model import Refused
from controllers.card.profile import Profile


def within_limits(now: Channels, move: Profile, joint: bool) -> Profile:
    """The move as soft limits let it pass: ended dead on the limit, a joint one in all its channels at that instant.

    A channel that stands beyond a limit may move back. Raises Refused where the card refuses, but for endless moves.
    """
    card, lanes = now.card, now.due.shape
    limits = card.soft_limits
    if limits is None:
        return move
    if len(limits) != lanes[-1]:
        raise Refused(f"{card.name}: {len(limits)} soft limits for {lanes[-1]} channels; give one pair for each")
    at, target = np.full(lanes, np.inf), np.array(move.target)
    for lane in np.argwhere(now.due):
        i = tuple(lane)
        low, high = limits[lane[-1]]
        found, stand = _passing(move, i, low, high)
        if found == np.inf:
            continue
        if card.at_soft_limit == "refuse" and np.isfinite(move.end[i]):
            raise Refused(
                f"{card.name}, channel {lane[-1] + 1}: the move to {move.target[i]:.10g} passes the soft limits {low} "
                f"… {high} pulses; keep it inside, or move the limits"
            )
        at[i], target[i] = found, stand
    if joint:
        first = np.where(now.due, at, np.inf).min(-1, keepdims=True)
        target = np.where(at <= first, target, np.nan)
        at = np.where(now.due, first, at)
    stopped = cut(move, at)
    ends = at < move.end
    return replace(stopped, target=np.where(ends & ~np.isnan(target), target, stopped.target))


def _passing(move: Profile, lane: tuple[int, ...], low: int, high: int) -> tuple[float, float]:
    """When the channel first goes beyond a limit, s, and where it is to stand; (inf, 0) where it never does."""
    begin, p = float(move.begin[lane]), float(move.start[lane])
    if begin == np.inf:
        return np.inf, 0.0
    for i, length in enumerate(np.moveaxis(move.lengths, 0, -1)[lane].tolist()):
        at = begin + (length if length < np.inf else 0.0)
        q = float(move.position(np.array([at]))[(0, *lane)])
        rising = move.speeds[(i, *lane)] if length == np.inf else q - p
        for limit, sign in ((high, 1), (low, -1)):
            if sign * rising <= 0 or (length < np.inf and sign * (q - limit) <= 0):
                continue
            if sign * (p - limit) >= 0:
                return begin, p
            return _instant(move, lane, i, begin, length, p, limit), float(limit)
        begin, p = at, q
    return np.inf, 0.0


def _instant(
    move: Profile, lane: tuple[int, ...], i: int, begin: float, length: float, p: float, limit: float
) -> float:
    """When piece i of a channel comes to the limit: halved, since it runs one way, to the last bit."""
    if length == np.inf:
        return begin + (limit - p) / float(move.speeds[(i, *lane)])
    low, high = begin, begin + length
    while low < (middle := (low + high) / 2) < high:
        before = (float(move.position(np.array([middle]))[(0, *lane)]) - limit) * (p - limit) > 0
        low, high = (middle, high) if before else (low, middle)
    return high
