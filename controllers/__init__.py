"""Emulated hardware and tracking: motion card, servo, tracking laws, simulation, error metrics."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
