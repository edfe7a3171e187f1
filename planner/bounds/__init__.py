"""Proved lower bounds of the duration, the multipliers that prove them, and what each limit is worth."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
