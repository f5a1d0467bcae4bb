"""Fleets: many campaigns calibrated side by side, and what they say of the trucks and of the population."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
