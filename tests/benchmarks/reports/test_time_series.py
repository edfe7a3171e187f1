"""Series of a page: thinning keeps every extreme, and what a page holds is what was drawn."""

from base64 import b64decode
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from benchmarks.reports.time_series import keep_extremes, pack_panels, read_panels
from kinematics.foundation.figure import literal_label
from kinematics.foundation.line_styles import line_style


@given(st.integers(1, 700), st.integers(8, 60), st.integers(0, 2**32 - 1))
def test_thinning_keeps_extremes_and_order(count, most, seed):
    rng = np.random.default_rng(seed)
    t, values = (
        np.sort(rng.random(count)),
        rng.choice([1.0, 2.0, 3.5, -4.0], count) * rng.integers(1, 9, count),
    )
    kept_t, kept = keep_extremes(t, values, most)
    assert len(kept_t) == len(kept) <= 2 * most + 2
    assert (np.diff(kept_t) >= 0).all()
    assert (kept_t[0], kept_t[-1], kept[0], kept[-1]) == (t[0], t[-1], values[0], values[-1])
    if len(kept) == count:
        np.testing.assert_array_equal(kept, values)
        return
    # every stretch between two of the new instants holds samples within its two values, which are
    # two of them
    edges = np.searchsorted(t, np.append(kept_t[1:-1:2], t[-1]))
    for k, (first, after) in enumerate(pairwise(edges)):
        stretch, pair = values[first:after], kept[1 + 2 * k : 3 + 2 * k]
        assert (stretch.min(), stretch.max()) == (pair.min(), pair.max())
        assert (stretch.argmin() <= stretch.argmax()) == (pair[0] <= pair[1])


def test_series_that_share_their_instants_share_the_thinned_ones():
    t, rng = np.linspace(0, 1, 50_001), np.random.default_rng(1)
    kept = [keep_extremes(t, rng.random(len(t)))[0] for _ in range(3)]
    for other in kept[1:]:
        np.testing.assert_array_equal(other, kept[0])


def test_a_peak_of_one_sample_in_a_million_survives():
    t, values = np.linspace(0, 1, 1_000_000), np.zeros(1_000_000)
    values[[123_456, 654_321]] = 5.0, -7.0
    kept_t, kept = keep_extremes(t, values)
    assert len(kept) <= 4002
    assert kept_t[kept == 5.0] == pytest.approx(t[123_456], abs=1 / 2000)
    assert kept_t[kept == -7.0] == pytest.approx(t[654_321], abs=1 / 2000)


def unpack(text):
    return np.frombuffer(b64decode(text), "<f4")


def test_a_page_holds_what_was_drawn():
    figure = Figure()
    first, second, third = figure.subplots(3, 1)
    t = np.linspace(0, 2, 50)
    for n, name in enumerate(("leg$1", "_leg2")):
        first.plot(t, (n + 1) * np.sin(t), label=literal_label(name), **line_style(7 * n))
    first.axhline(0.5, color="#E69F00", linestyle=(0, (6, 3)))
    first.axvline(1.0)
    second.stairs([1.0, 3.0], [0.0, 0.5, 2.0], baseline=None, label="use")
    third.plot(t, t, label="elsewhere")
    first.set(xlabel="time (s)", ylabel="speed (mm/s)")
    second.set(xlabel="time (s)", ylabel="share")
    third.set(xlabel="distance (mm)")
    page = pack_panels({"motion": read_panels([first, second, third])})
    speed, share = page["figures"]["motion"]
    assert (speed["label"], speed["levels"], share["levels"]) == (
        "speed (mm/s)",
        [(0.5, "#e69f00")],
        [],
    )
    assert [one["name"] for one in speed["series"]] == ["leg$1", "_leg2"]
    assert [one["dash"] for one in speed["series"]] == [0, 1]
    assert len(page["times"]) == 2  # that of the two lines, and that of the stairs
    for n, one in enumerate(speed["series"]):
        np.testing.assert_array_equal(unpack(page["times"][one["t"]]), t.astype("<f4"))
        np.testing.assert_array_equal(unpack(one["y"]), ((n + 1) * np.sin(t)).astype("<f4"))
    (steps,) = share["series"]
    assert steps["step"]
    assert unpack(page["times"][steps["t"]]).tolist() == [0.0, 0.5, 2.0]
    assert unpack(steps["y"]).tolist() == [1.0, 3.0, 3.0]  # the last value holds to the end


def test_axes_that_share_time_are_read_by_the_label_of_the_last():
    upper, lower = Figure().subplots(2, 1, sharex=True)
    for ax in (upper, lower):
        ax.plot([0, 1], [0, 1], label="a")
    lower.set_xlabel("time (s)")
    assert len(read_panels([upper, lower])) == 2
    lower.set_xlabel("station")
    assert read_panels([upper, lower]) == ()


def test_a_second_scale_upon_the_same_axes_is_a_panel_of_its_own():
    ax = Figure().subplots()
    other = ax.twinx()
    ax.plot([0, 1], [0, 1], label="time to rest")
    other.plot([0, 1], [5, 6], label="distance to rest")
    ax.set(xlabel="time (s)", ylabel="s")
    other.set_ylabel("mm")
    assert [(panel.label, panel.series[0].name) for panel in read_panels([ax])] == [
        ("s", "time to rest"),
        ("mm", "distance to rest"),
    ]


def test_a_series_without_a_name_is_no_part_of_it():
    ax = Figure().subplots()
    ax.plot([0, 1], [0, 1])
    ax.set_xlabel("time (s)")
    assert read_panels([ax]) == ()
    assert pack_panels({"none": ()}) == {"times": [], "figures": {}}
