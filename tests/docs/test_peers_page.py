"""The page of peers and the README's rows are made from the table, and their words hold."""

from pathlib import Path

from benchmarks.evidence.cases.peers_page import (
    CIRCLE,
    DURATION,
    OURS,
    SLOWED,
    SPLINE,
    TIME,
    find_figures,
    read_answers,
    select,
)
from benchmarks.evidence.run import render_case

ROOT = Path(__file__).parents[2]


def test_the_page_is_what_its_command_makes():
    stale = "stale: python -m benchmarks.evidence peers_page --out docs/peers.md"
    assert (ROOT / "docs/peers.md").read_text(encoding="utf-8") == render_case("peers_page"), stale


def test_the_rows_of_the_readme_are_those_measured():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = render_case("peers_page", readme=True)
    assert len(rows.splitlines()) == 5
    assert rows in readme, "stale: python -m benchmarks.evidence peers_page --readme"


def test_the_row_of_the_index_is_that_measured():
    share = find_figures(read_answers())["copp_share"]
    index = (ROOT / "docs/evidence/index.md").read_text(encoding="utf-8")
    assert f"with its certificate | {share:.2g} of copp-py's time |" in index


def test_the_words_of_the_page_hold():
    answers = read_answers()
    figures = find_figures(answers)
    assert figures["reference_ratio"] > 1  # "times the time"
    assert figures["straight_ratio"] > 1  # "times faster"
    assert figures["copp_share"] < 1  # "where ours is ahead"
    assert 1 < figures["least_loss"] < figures["most_loss"]
    for case in (CIRCLE, SPLINE):
        *_, copp = select(answers, case, "2", "copp-py")
        finest, *_, passes = select(answers, case, "2", "ours, uncertified")
        # "our order-2 passes take about as long as copp-py's"
        assert 0.7 < float(passes[TIME]) / float(copp[TIME]) < 1.3
        (certified,) = select(answers, case, "2", OURS)
        assert 0.999 < float(finest[SLOWED]) / float(certified[SLOWED]) < 1  # "a little shorter"
    reference, ours = (select(answers, CIRCLE, "3", method)[0] for method in ("IPOPT", OURS))
    assert 0.9995 < float(reference[SLOWED]) / float(ours[SLOWED]) < 1  # and order3.md: 0.03 %
    certified = [answer for answer in answers if answer["method"] == OURS]
    assert max(float(answer[SLOWED]) / float(answer[DURATION]) for answer in certified) < 1 + 1e-6
