"""What holds for all tests."""

import signal
from collections.abc import Generator

import pytest
from hypothesis import settings

from kinematics.foundation.errors import NotInstalled

# The same code gives the same verdict; to look for new examples: pytest --hypothesis-profile=default
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# A shell starts what it runs in the background deaf to Ctrl-C, and the commands of the tests would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup() -> Generator[None]:
    """Where a package has no wheel, or an extra was not installed, what needs it is skipped and says what it needs."""
    try:
        yield
    except NotInstalled as absent:
        pytest.skip(str(absent))


pytest_runtest_call = pytest_runtest_setup
