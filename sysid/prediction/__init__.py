"""Wheel loads of passes that nobody drove, and natural modes of the calibrated truck."""

from sysid.prediction.calibrated import calibrated_vehicle
from sysid.prediction.calibrated_elements import CalibratedSuspension, CalibratedVehicle
from sysid.prediction.calibrated_truck_modes import calibrated_modes
from sysid.prediction.passes import predict, predict_pass, speed_sweep
from sysid.prediction.predicted_passes import PassPrediction, Predictions, Quantiles, SpeedSweep

__all__ = [
    "CalibratedSuspension",
    "CalibratedVehicle",
    "PassPrediction",
    "Predictions",
    "Quantiles",
    "SpeedSweep",
    "calibrated_modes",
    "calibrated_vehicle",
    "predict",
    "predict_pass",
    "speed_sweep",
]
