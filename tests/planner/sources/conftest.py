"""What the tests of G-code share."""

import pytest

from planner import import_program


@pytest.fixture
def read(tmp_path):
    """The text of a file, and options -> what is imported."""

    def read_text(text, suffix=".nc", **options):
        path = tmp_path / f"part{suffix}"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return import_program(path, **options)

    return read_text
