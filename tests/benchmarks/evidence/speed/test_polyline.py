from benchmarks.evidence.speed.polyline import run, run_in_windows, walk


def test_a_longer_polyline_takes_no_more_intervals_a_line():
    """Proved, so that each is a motion; the longer one shares its ramps from and to rest among more lines."""
    few, more = run(6), run(24)
    assert more.intervals / 24 < 1.1 * few.intervals / 6
    assert more.duration / 24 < few.duration / 6
    assert more.method.startswith("riccati")
    assert "rests" not in more.method


def test_walks_are_the_same_for_the_same_seed_and_stay_near_the_middle():
    ends = [segment.to for segment in walk(300).segments]
    assert [segment.to.tolist() for segment in walk(300).segments] == [end.tolist() for end in ends]
    assert max((end[:2] ** 2).sum() for end in ends) < 0.02**2


def test_windows_lead_to_the_same_motion_as_the_whole():
    whole, windows = run(40), run_in_windows(40)
    assert windows.duration < 1.001 * whole.duration
    assert windows.intervals < 1.3 * whole.intervals
