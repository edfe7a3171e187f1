"""Whether the axes and the load that a machine is given fit it."""

from collections import Counter
from collections.abc import Iterable

from kinematics.axis import Axis
from kinematics.errors import BadValue, MotionError
from kinematics.kind import Kind
from kinematics.load import Load


def driven(of: Kind, name: str, given: Iterable[Axis]) -> tuple[Axis, ...]:
    """As many axes as there are freedoms, each of its sort, no two with the same name or the same driver."""
    kind, count = type(of).__name__.lower(), len(of.freedom)
    axes = tuple(given) if isinstance(given, Iterable) else (given,)
    strange = [axis for axis in axes if not isinstance(axis, Axis)]
    if strange:
        raise MotionError(f"machine {name}: axes must be {count} of Axis, not {strange[0]!r:.100}")
    if len(axes) != count:
        raise MotionError(f"machine {name}: {len(axes)} axes; a {kind} has {count}, for {', '.join(of.freedom)}")
    for axis, sort in zip(axes, of.sorts, strict=False):
        if axis.kind != sort:
            raise MotionError(f"machine {name}: axis {axis.name} is {axis.kind}; a {kind} has a {sort} one there")
    if len({axis.name for axis in axes}) < count:
        raise MotionError(f"machine {name}: two axes have the same name; names tell the limits of one from another's")
    wired = Counter((axis.card, axis.channel) for axis in axes if axis.card is not None)
    for (card, channel), times in wired.items():
        if times > 1:
            both = [axis.name for axis in axes if (axis.card, axis.channel) == (card, channel)]
            raise BadValue(
                f"machine {name}: {' and '.join(both)} are both on channel {channel} of card {card}; "
                "give each one of its own",
                key=(both[-1],),
            )
    return axes


def bearing(of: Kind, name: str, load: Load) -> Load:
    """A load that fits the machine. Raises MotionError for legs that it has not."""
    if load.legs and of.legs == 0:
        raise MotionError(f"machine {name} has no legs that could have masses")
    if len(load.legs) not in (0, 1, of.legs):
        raise MotionError(f"machine {name}: {len(load.legs)} legs with masses; give one for all, or {of.legs}")
    return load
