"""A trapezoidal move taken from wherever it is to a target, at other speeds: what changes on the fly come to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from controllers.card.channels import Channels
from controllers.card.lanes import registers_of
from controllers.card.profile import Profile
from kinematics.array import Array


def locked(now: Channels) -> np.ndarray:
    """(…) whether a move is under way that takes no change."""
    return np.asarray(np.isinf(registers_of(now.running)[0]) & (now.running.end > now.begin))


def steerable(now: Channels) -> np.ndarray:
    """(…) whether a trapezoidal move is under way."""
    return np.asarray(np.isfinite(registers_of(now.running)[0]) & (now.running.end > now.begin))


def lock(move: Profile) -> Profile:
    """The move as one that takes no change on the fly."""
    return replace(move, registers=np.full((4, *move.begin.shape), np.inf))


def steered(now: Channels, target: Array, registers: Array, *, overshoots: bool) -> Profile:
    """From position and speed of the instant to a target at registers (start speed u, top speed w, rates up and down).

    Where the way is too short to ramp down to u at the rate of the ramp down, or leads back: the channel ramps down,
    and returns as a move that starts at u (`overshoots`); or it goes on to the target, and stops dead there.
    """
    # lanes without registers of their own are not looked at: any numbers serve
    low, top, up, down = np.where(np.isfinite(registers[0]), registers, 1.0)
    way, fast = target - now.position, np.abs(now.speed)
    toward = np.where(way < 0, -1.0, 1.0) * now.speed
    braking = np.maximum(fast * fast - low * low, 0.0) / (2 * down)
    over = ((toward < 0) | (braking > np.abs(way))) if overshoots else np.zeros(way.shape, bool)
    time = np.where(over, np.maximum(fast - low, 0.0) / down, 0.0)
    turn = now.position + np.where(over, np.sign(now.speed) * braking, 0.0)
    sign = np.where(target - turn < 0, -1.0, 1.0)
    lengths, speeds, rates = _reached(np.abs(target - turn), np.where(over, low, fast), top, low, up, down)
    # infinite rates come with ramps of no length
    brake = -np.sign(now.speed) * np.where(np.isfinite(down), down, 0.0)
    return Profile(
        now.begin,
        now.position,
        target,
        np.concatenate([time[None], lengths]),
        np.concatenate([now.speed[None], sign * speeds]),
        np.concatenate([brake[None], sign * rates]),
        registers=registers,
    )


def _reached(way: Array, v: Array, w: Array, u: Array, up: Array, down: Array) -> tuple[Array, Array, Array]:
    """Lengths, speeds and rates of three pieces over a way: from speed v to w at rate `up`, held, to u at rate `down`.

    Where that does not fit, the ramps meet at vp: rising, vp² = (2D + v²/up + u²/down)/(1/up + 1/down); falling to
    w < v more slowly than the ramp down, vp² = (v²/up − u²/down − 2D)/(1/up − 1/down). Where even braking at once is
    too late, or the slower ramp is the ramp down, it brakes at once, as far as the way goes.
    """
    slow_up, slow_down = 1 / up, 1 / down
    first, last = np.abs(w * w - v * v) * slow_up / 2, np.abs(w * w - u * u) * slow_down / 2
    fits = first + last <= way
    rising = w >= v
    sum_, gap = slow_up + slow_down, slow_up - slow_down
    meet = np.where(
        rising,
        (2 * way + v * v * slow_up + u * u * slow_down) / np.where(sum_ > 0, sum_, 1.0),
        np.where(gap > 0, v * v * slow_up - u * u * slow_down - 2 * way, 0.0) / np.where(gap > 0, gap, 1.0),
    )
    inside = np.where(rising, meet >= v * v, (gap > 0) & (meet <= v * v) & (meet >= w * w))
    top = np.where(fits, w, np.where(inside, np.sqrt(np.maximum(meet, 0.0)), v))
    first = np.minimum(np.abs(top * top - v * v) * slow_up / 2, way)
    left = way - first
    last = np.where(fits, last, left)
    fall = np.where(u > top, 1.0, -1.0)
    rate = fall * np.where(np.isfinite(down), down, 0.0)
    final = np.sqrt(np.maximum(top * top + 2 * rate * last, 0.0))
    held = np.where(fits, left - last, 0.0)
    some = np.where(top + final > 0, top + final, 1.0)
    lengths = np.stack((np.abs(top - v) * slow_up, held / np.where(top > 0, top, 1.0), 2 * last / some))
    rise = np.where(np.isfinite(up), np.where(top >= v, up, -up), 0.0)
    return lengths, np.stack((v, top, top)), np.stack((rise, np.zeros_like(rise), rate))
