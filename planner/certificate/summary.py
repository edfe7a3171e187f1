"""The certificate of a long motion in few numbers: what each part of it uses of the limits, and the parts joined."""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array
from planner.certificate.certify import Certificate, find_place
from planner.limits import Limit
from planner.place import Place
from planner.trajectory import Trajectory

MOST_ENTRIES = 512
"""Of each limit in the certificate of a plan that was made in parts."""


def summarise_part(certificate: Certificate, motion: Trajectory, limits: Sequence[Limit], part: slice) -> Certificate:
    """Of a window's certificate what concerns some of its time pieces, as one entry of each limit."""
    worst, where, use, attained = dict[str, float](), dict[str, Place](), {}, {}
    for name, values in certificate.use.items():
        worst[name] = float(values[part].max())
        where[name] = certificate.where[name]
        if worst[name] < certificate.worst[name]:  # that place is in another part
            k = part.start + int(np.argmax(certificate.attained[name][part]))
            where[name] = find_place(motion, limits, name, k)
        use[name] = np.array([worst[name]])
        attained[name] = certificate.attained[name][part].max(keepdims=True)
    return Certificate(certificate.holds, worst, where, use, attained)


def join_certificates(one: Certificate, other: Certificate) -> Certificate:
    """One over the parts of both. A limit that has nothing to bind in one of them is used by nothing there.

    Where there are many entries, two become one: what is kept does not grow with the program.
    """
    names = dict.fromkeys((*one.use, *other.use))
    sizes = [len(next(iter(each.use.values()))) for each in (one, other)]
    use, attained = (
        {
            name: np.concatenate(
                [getattr(each, what).get(name, np.zeros(size)) for each, size in zip((one, other), sizes, strict=True)]
            )
            for name in names
        }
        for what in ("use", "attained")
    )
    if sum(sizes) > MOST_ENTRIES:
        use, attained = ({name: _merge_pairs(values) for name, values in each.items()} for each in (use, attained))
    higher = {name: one if one.worst.get(name, -1.0) >= other.worst.get(name, -1.0) else other for name in names}
    return Certificate(
        one.holds and other.holds,
        {name: each.worst[name] for name, each in higher.items()},
        {name: each.where[name] for name, each in higher.items()},
        use,
        attained,
    )


def _merge_pairs(values: Array) -> Array:
    """The larger of each two, and the last by itself where it has no other."""
    return np.maximum.reduceat(values, np.arange(0, len(values), 2))
