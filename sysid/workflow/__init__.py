"""The order of the stages of a calibration, and what they leave on disk."""

from sysid.workflow.calibration import STAGES, Calibration, versions
from sysid.workflow.settings import Settings, make_settings, recall

__all__ = ["STAGES", "Calibration", "Settings", "make_settings", "recall", "versions"]
