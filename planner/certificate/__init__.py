"""The certificate: a bound of every limit over continuous time, which trusts no solver."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
