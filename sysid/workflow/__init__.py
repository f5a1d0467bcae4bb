"""The stages of a calibration, what they leave on disk, and :class:`Calibration`, which runs them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.workflow.calibration import Calibration
    from sysid.workflow.settings import KEPT_CHOICES, Settings, make_settings, recall

# Loaded when they are first used: the command line shows the records of the stages without NumPy and JAX.
_HOMES = {
    "KEPT_CHOICES": "sysid.workflow.settings",
    "Calibration": "sysid.workflow.calibration",
    "Settings": "sysid.workflow.settings",
    "make_settings": "sysid.workflow.settings",
    "recall": "sysid.workflow.settings",
}

__all__ = ["KEPT_CHOICES", "Calibration", "Settings", "make_settings", "recall"]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
