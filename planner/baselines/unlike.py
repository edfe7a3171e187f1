"""What a classical timing does otherwise than a plan: said beside every saving, so that like is compared with like."""

from collections.abc import Sequence

from planner.baselines.classical import Classical
from planner.certify import CROSSING
from planner.limits.resonance import Resonance
from planner.plan import Plan


def missing_limits(plan: Plan, timing: Classical) -> tuple[str, ...]:
    """What the plan is proved to keep, and the timing is not, as certificates call it: left out of it, or broken."""
    kept = _kept(timing)
    missing = [name for name in plan.certificate.worst if name not in kept]
    return tuple(name for name in missing if name != CROSSING or Resonance.name not in missing)


def describe_differences(plan: Plan, timing: Classical) -> tuple[str, ...]:
    """What else than its shape of speed is not as in the plan, each in a few words; nothing where all is alike."""
    told = []
    if missing := missing_limits(plan, timing):
        told.append(f"without {', '.join(missing)}")
    if more := [name for name in _kept(timing) if name not in plan.certificate.worst]:
        told.append(f"keeps {', '.join(more)} too")
    if not timing.certificate.holds:
        told.append("not certified")
    if timing.deviation is not None:
        told.append(f"off the path by up to {1e3 * timing.deviation.distance:.3f} mm")
    if not plan.path.stops(plan.order).all():
        told.append("stops at every join")
    if plan.path.end_speeds != (0.0, 0.0):
        told.append("from rest to rest")
    return tuple(told)


def _kept(timing: Classical) -> list[str]:
    return [name for name, worst in timing.certificate.worst.items() if worst <= 1]


def pick_baseline(plan: Plan, timings: Sequence[Classical]) -> Classical:
    """Of the timings along the path the one that leaves out the fewest of the plan's limits; of several, the quickest.

    It is what a saving is told against: under the same limits wherever there is such a timing.
    """
    along = [timing for timing in timings if timing.deviation is None and timing.certificate.holds]
    return min(along, key=lambda timing: (len(missing_limits(plan, timing)), timing.duration))
