"""The measurement campaign: records, reader, statics and quality check (SI units, no physics beyond statics)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
