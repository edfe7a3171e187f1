"""What holds for the tests of processes."""

import pytest


@pytest.fixture(autouse=True)
def several(all_cores):
    """The second process is started only where there is a core for it."""
