from benchmarks.evidence.peers.problems import circle
from benchmarks.evidence.speed.intervals import EVEN, OURS, compare, draw, table


def test_points_where_time_is_lost_earn_it(tmp_path):
    """As many even intervals lose several times as much beside a fine grid, and more intervals lose less."""
    answers = list(compare(circle(), (0.5, 1.0, 2.0)))
    ours, even = ([one for one in answers if one.grid == grid] for grid in (OURS, EVEN))
    assert [one.intervals for one in ours] == [one.intervals for one in even] == [120, 240, 480]
    best = ours[-1].duration
    for own, other in zip(ours[:-1], even[:-1], strict=True):
        assert best < own.duration < best + (other.duration - best) / 4
    assert ours[0].duration > ours[1].duration
    assert even[0].duration > even[1].duration > even[2].duration
    assert table(answers).count("\n") == 2 + len(answers) - 1
    draw(answers, tmp_path / "drawn" / "intervals.png")
    assert (tmp_path / "drawn" / "intervals.png").stat().st_size > 1000
