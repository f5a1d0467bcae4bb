"""Bridges under moving vehicles: influence lines, natural modes, static and dynamic load effects, code vehicles."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
