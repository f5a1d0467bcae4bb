"""Files of loggers: from the bytes of a file to channels with their own time, whatever the format."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
