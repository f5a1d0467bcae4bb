"""The stages of a calibration, what they leave on disk, and :class:`Calibration`, which runs them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
