"""The virtual motion card: models, commands, and the state that commands change."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
