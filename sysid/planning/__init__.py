"""What to measure next: runs, sensors and masses ranked by what they would bring."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
