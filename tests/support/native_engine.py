"""Tests that need the compiled engine: skipped, and said so at the end of the run, where there is no C++ compiler."""

from __future__ import annotations

import pytest

from sysid.vehicle_model.native import prebuilt
from sysid.vehicle_model.native.build import find_compiler

REASON = "no C++ compiler on this machine: the native engine was not tested"

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason=REASON)
#: A wheel brings the engine with it.
needs_native = pytest.mark.skipif(
    find_compiler() is None and not (prebuilt.FOLDER / prebuilt.LIST).is_file(), reason=REASON
)
