"""Plank drops: peaks, damped period and decrement, stiffness and damping per axle by equations (1)-(3) and beyond."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
