"""Agreement between simulated and measured histories."""

from sysid.validation.agreement import nrmse, validate
from sysid.validation.results import ChannelAgreement, Validation

__all__ = ["ChannelAgreement", "Validation", "nrmse", "validate"]
