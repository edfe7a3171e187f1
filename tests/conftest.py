"""What holds for all tests."""

from hypothesis import settings

# The same code gives the same verdict; to look for new examples: pytest --hypothesis-profile=default
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
