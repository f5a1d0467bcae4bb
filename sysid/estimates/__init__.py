"""Results of a calibration for the truck: stiffness and damping per axle, modes, suspension curves, effective roads."""

from sysid.estimates.records import Estimates
from sysid.estimates.suspension_values import AxleEstimates, Estimate, suspension_estimates

__all__ = ["AxleEstimates", "Estimate", "Estimates", "suspension_estimates"]
