"""Road side of the toolkit: point cloud, road plane, smooth bump profile, analytic bump shapes, effective profile."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
