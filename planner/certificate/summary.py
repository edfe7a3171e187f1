"""The certificate of a long motion in few numbers: the use of limits by each part, and all
joined.
"""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array
from planner.certificate.certify import Certificate, find_place
from planner.limits import Limit
from planner.place import Place
from planner.trajectory import Trajectory

MOST_ENTRIES = 512
"""Entries per limit in the certificate of a plan that is made in parts."""


def summarise_part(
    certificate: Certificate,
    motion: Trajectory,
    limits: Sequence[Limit],
    part: slice,
) -> Certificate:
    """Return the certificate of some time pieces of a window, with one entry per limit."""
    worst: dict[str, float] = {}
    where: dict[str, Place] = {}
    use: dict[str, Array] = {}
    attained: dict[str, Array] = {}
    for name, values in certificate.use.items():
        attained_here = certificate.attained[name][part]
        worst[name] = float(values[part].max())
        where[name] = certificate.where[name]
        if worst[name] < certificate.worst[name]:  # the worst place is in another part
            k = part.start + int(np.argmax(attained_here))
            where[name] = find_place(motion, limits, name, k)
        use[name] = np.array([worst[name]])
        attained[name] = attained_here.max(keepdims=True)
    return Certificate(certificate.holds, worst, where, use, attained)


def join_certificates(one: Certificate, other: Certificate) -> Certificate:
    """Join two certificates. A limit that binds nothing in one of them is not used there.

    Neighbouring entries are merged where there are many, so that their number does not grow with
    the program.
    """
    higher: dict[str, Certificate] = {}
    for name in (*one.use, *other.use):
        is_first = one.worst.get(name, -1.0) >= other.worst.get(name, -1.0)
        higher[name] = one if is_first else other
    return Certificate(
        holds=one.holds and other.holds,
        worst={name: each.worst[name] for name, each in higher.items()},
        where={name: each.where[name] for name, each in higher.items()},
        use={name: _join_entries(one.use, other.use, name) for name in higher},
        attained={name: _join_entries(one.attained, other.attained, name) for name in higher},
    )


def _join_entries(
    one: dict[str, Array],
    other: dict[str, Array],
    name: str,
) -> Array:
    """Return the entries of both tables for a limit: 0 in a table without it.

    Pairs are merged if there are too many.
    """
    columns = []
    for table in (one, other):
        any_column = next(iter(table.values()))
        columns.append(table.get(name, np.zeros_like(any_column)))
    entries = np.concatenate(columns)
    if len(entries) <= MOST_ENTRIES:
        return entries
    pairs = np.arange(0, len(entries), 2)
    return np.maximum.reduceat(entries, pairs)
