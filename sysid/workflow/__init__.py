"""The stages of a calibration, what they leave on disk, and :class:`Calibration`, which runs them."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sysid.workflow.calibration import Calibration
    from sysid.workflow.settings import KEPT_CHOICES, Settings, make_settings, recall
    from sysid.workflow.versions import versions

# Loaded when they are first used: the command line shows the records of the stages without NumPy and JAX.
_HOMES = {
    "KEPT_CHOICES": "sysid.workflow.settings",
    "Calibration": "sysid.workflow.calibration",
    "Settings": "sysid.workflow.settings",
    "make_settings": "sysid.workflow.settings",
    "recall": "sysid.workflow.settings",
    "versions": "sysid.workflow.versions",
}

__all__ = ["KEPT_CHOICES", "Calibration", "Settings", "make_settings", "recall", "versions"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
