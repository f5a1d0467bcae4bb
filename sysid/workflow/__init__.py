"""The order of the stages of a calibration, and what they leave on disk."""

from sysid.workflow.calibration import STAGES, Calibration, versions
from sysid.workflow.settings import Settings, make_settings

__all__ = ["STAGES", "Calibration", "Settings", "make_settings", "versions"]
