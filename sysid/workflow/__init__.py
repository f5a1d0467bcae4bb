"""The order of the stages of a calibration, and what they leave on disk."""

from sysid.workflow.calibration import Calibration
from sysid.workflow.settings import KEPT_CHOICES, Settings, make_settings, recall
from sysid.workflow.stage_folder import STAGES
from sysid.workflow.versions import versions

__all__ = ["KEPT_CHOICES", "STAGES", "Calibration", "Settings", "make_settings", "recall", "versions"]
