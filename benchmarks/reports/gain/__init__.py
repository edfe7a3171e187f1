"""Saved runs compared: what is better than a baseline, by how much, and at what cost; the gain
report.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
