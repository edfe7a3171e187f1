"""Small generated CAM files: slow feeds between rapids, never slower than the classical timing."""

from math import sqrt

import pytest

from benchmarks.evidence.cases.cam_files import (
    find_files,
    make_machine,
    plan_file,
    read_program,
    try_file,
)
from benchmarks.evidence.workpieces import FEEDS, SHAPES, generate_cam_file, write_shape
from planner import plan

# m
FIT = 2e-5
# Share of the proved lower bound by which a feed-limited motion may be above it.
MAX_GAP = 1e-3
# Features and seeds of files of less than 25 lines.
SAMPLES = [
    ("contour", 6),
    ("pocket", 18),
    ("bore", 7),
    ("drilling", 7),
    ("letters", 7),
    ("curve", 18),
]


@pytest.fixture(scope="module")
def machine():
    return make_machine()


@pytest.fixture
def write_file(tmp_path):
    """Write the text of a file and return its path."""

    def write(text, name="part.nc"):
        file = tmp_path / name
        file.write_text(text)
        return file

    return write


# Order 2 is the easier one, and fitted curves are timed like joined lines: fewer of them. All are
# tried by the case `cam_files` of the evidence.
FITTED = [("pocket", 18, 2), ("curve", 18, 3)]
CASES = [
    *[(*sample, 3, None) for sample in SAMPLES],
    *[(*sample, 2, None) for sample in SAMPLES[:2]],
    *[(*sample, FIT) for sample in FITTED],
]


@pytest.mark.parametrize(("feature", "seed", "order", "fit"), CASES)
def test_no_file_is_slower_than_classical_timing(write_file, machine, feature, seed, order, fit):
    """The baseline has the same limits, and stops at every join: a plan may do the same."""
    file = write_file(generate_cam_file(seed, [feature]))

    run = plan_file(file, machine, order, fit)

    assert run.certified
    assert run.motion <= run.baseline
    assert 0 <= run.gap <= MAX_GAP
    assert not run.marks


@pytest.mark.parametrize("feed", [5.0, 60.0, 600.0])
def test_a_rapid_that_ends_at_a_feed_is_bounded_by_the_feed(write_file, machine, feed):
    """Drilling at order 2 in closed form: the rapid must brake to the feed before the join.

    The bound did not know the feed at the join: it was 1.3 % below the least time at 60 mm/min, and
    5.7 % at 600 mm/min. Lengths of the four moves, mm: 5, 4.5, then 1.5 at the feed, and 2.
    """
    text = f"G21 G90 G17\nG0 Z5\nG0 Z0.5\nG1 Z-1 F{feed}\nG0 Z1\nM2\n"
    acceleration = machine.axes[2].max_acceleration
    speed = feed / 60e3
    # from rest to the feed: up to the peak p and down again, p² - v²/2 = A L
    peak = sqrt(acceleration * 4.5e-3 + speed**2 / 2)
    assert peak < machine.axes[2].max_speed
    rapid = (2 * peak - speed) / acceleration
    drill = 1.5e-3 / speed + speed / acceleration / 2
    rests = 2 * sqrt(5e-3 / acceleration) + 2 * sqrt(2e-3 / acceleration)
    least = rests + rapid + drill

    made = plan(read_program(write_file(text), None), machine, order=2)

    assert made.trajectory.duration == pytest.approx(least, rel=1e-5)
    assert least * (1 - MAX_GAP) <= made.lower_bound <= least


def test_a_seed_makes_one_file_of_ordinary_feeds():
    texts = [generate_cam_file(seed) for seed in range(20)]

    assert texts == [generate_cam_file(seed) for seed in range(20)]
    assert len(set(texts)) == len(texts)

    for text in texts:
        unit = 25.4 if text.startswith("G20") else 1.0
        words = [word for line in text.splitlines() for word in line.split()]
        feeds = [unit * float(word[1:]) for word in words if word.startswith("F")]
        # a plunge goes at a tenth of the feed at least
        assert FEEDS[0] / 10 * 0.99 <= min(feeds)
        assert max(feeds) <= FEEDS[1] * 1.001
        assert {"G0", "G1"} <= {*words}


def test_a_folder_is_planned_with_its_refusals(write_file, machine, tmp_path):
    write_file("G21 G90\nG0 X1\nM2\n", "a.ngc")
    write_file("G21 G90\nG1 X1\n", "b.NC")
    write_file("no G-code", "c.txt")

    files = find_files(tmp_path)
    runs = {
        file.name: try_file(file, lambda file: plan_file(file, machine, 2, None)) for file in files
    }

    assert runs.keys() == {"a.ngc", "b.NC"}
    assert runs["a.ngc"].certified
    assert "no F is active" in runs["b.NC"].refusal
    assert "no F is active" in runs["b.NC"].row(files[-1])[-1]


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_is_read(name, tmp_path):
    program = read_program(write_shape(name, 60, tmp_path / "part.nc"), None)
    assert 50 <= len(program.segments) <= 80
