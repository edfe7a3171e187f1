"""CasADi's own warnings, kept from standard error."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import get_ident
from typing import Any


class _Others:
    """A stream that passes on what all threads but one write."""

    def __init__(self, stream: Any) -> None:
        self._stream, self._unheard = stream, get_ident()

    def write(self, text: str) -> int:
        if get_ident() != self._unheard and self._stream is not None:
            self._stream.write(text)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def quiet() -> Iterator[None]:
    """What the calling thread writes to sys.stderr is dropped; what others write is not. One caller at a time.

    A solve that FATROP gives up makes CasADi warn of multipliers that nobody asked for: it is told what became of the
    solve in other ways, no option turns the warning off (calc_lam_p does where IPOPT gives up), and it is written
    through sys.stderr, so that no file descriptor has to be touched.
    """
    stream = sys.stderr
    sys.stderr = _Others(stream)
    try:
        yield
    finally:
        sys.stderr = stream
