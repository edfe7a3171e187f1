"""The operator's console: any machine on the virtual card, by lines of text, from a keyboard or a
remote computer.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
