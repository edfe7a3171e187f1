from benchmarks.evidence.cases.intervals import EVEN, OURS, compare, walk
from benchmarks.evidence.peers.problems import circle
from kinematics import load_machine
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.timing import certified_solve


def test_points_where_time_is_lost_earn_it():
    """As many even intervals lose several times as much beside a fine grid, and more intervals lose less."""
    answers = list(compare(circle(), (0.5, 1.0, 2.0)))
    ours, even = ([one for one in answers if one.grid == grid] for grid in (OURS, EVEN))
    assert [one.intervals for one in ours] == [one.intervals for one in even] == [120, 240, 480]
    best = ours[-1].duration
    for own, other in zip(ours[:-1], even[:-1], strict=True):
        assert best < own.duration < best + (other.duration - best) / 4
    assert ours[0].duration > ours[1].duration
    assert even[0].duration > even[1].duration > even[2].duration


def test_a_longer_polyline_takes_no_more_intervals_a_line():
    """The longer one shares its ramps from and to rest among more lines."""
    machine = load_machine("hexapod")
    motions = {}
    for lines in (6, 24):
        path = actuate(walk(lines), machine)
        solution = certified_solve(path, limits_of(path, machine.axes, 3), 3)
        assert solution.certificate.holds
        assert solution.methods[0].startswith("riccati")
        assert "rests" not in solution.methods[0]
        motions[lines] = solution.trajectory
    assert len(motions[24].s) / 24 < 1.1 * len(motions[6].s) / 6
    assert motions[24].duration / 24 < motions[6].duration / 6
