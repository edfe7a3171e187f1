"""Limits as data, twice: rows for the solvers, a physical quantity for the certificate."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
