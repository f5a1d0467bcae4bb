"""Tests that need the compiled engine: skipped, and said so at the end of the run, where there is no C++ compiler."""

from __future__ import annotations

import pytest

from sysid.vehicle_model.native.build import find_compiler

REASON = "no C++ compiler on this machine: the native engine was not tested"

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason=REASON)
