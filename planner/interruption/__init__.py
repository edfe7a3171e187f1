"""A certified motion interrupted: stopped along its path, gone on with, and run slower."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
