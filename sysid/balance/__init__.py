"""Stiffness and damping from the balance of forces on the bodies, without road, bump or tire."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
