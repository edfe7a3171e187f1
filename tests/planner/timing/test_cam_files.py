"""Small generated CAM files: slow feeds between rapids, never slower than the classical timing."""

import numpy as np
import pytest

from benchmarks.evidence.speed import cam_files
from benchmarks.evidence.speed.cam_files import (
    FEATURES,
    FEEDS,
    CamOptions,
    generate_cam_file,
    make_machine,
    plan_file,
    summarize,
    try_file,
)

FIT = 2e-5
"""m"""
MAX_GAP = 1e-3
"""Share of the proved lower bound by which a feed-limited motion may be above it."""


@pytest.fixture(scope="module")
def machine():
    return make_machine()


@pytest.fixture
def write_file(tmp_path):
    """Write a generated file and return its path."""

    def write(seed, features=None):
        file = tmp_path / f"seed-{seed}.nc"
        file.write_text(generate_cam_file(seed, features))
        return file

    return write


@pytest.mark.parametrize("fit", [None, FIT], ids=["joined", "fitted"])
@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize(("seed", "feature"), list(enumerate(FEATURES)))
def test_no_file_is_slower_than_the_classical_timing(
    write_file, machine, seed, feature, order, fit
):
    """The baseline keeps the same limits along the same path, so it is a motion that the plan may be."""
    run = plan_file(write_file(seed, [feature]), machine, CamOptions(order, fit))
    assert run.certified
    assert run.motion <= run.baseline
    assert 0 <= run.gap <= MAX_GAP
