"""Suspension stiffness and damping of heavy vehicles from plank drops and speed-bump runs.

The packages follow the flow of the data (`docs/architecture.md`).  The names below are loaded when they are first used;
notebooks in `examples/` show them at work.

- A whole calibration: `Calibration` with `make_settings`; every stage is a method and returns a frozen result.
- Single steps: `read_campaign`, `check_quality`, `analyse_drops`, `read_point_cloud`, `analyse_scan`,
  `effective_profiles`, `natural_modes`, `calibrated_modes`.
- Results have `summary()`, `to_pandas()` and, where they hold arrays, `to_xarray()`; figures are in `sysid.plot`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
