"""Pulse schedules: from a motion to exact clock ticks, and the independent proof that they stand
for it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
