"""How well a motion was tracked: errors per axis, in space and beside the path, and what they cost
the drives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
