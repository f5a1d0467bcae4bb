"""Wheel loads of passes nobody drove, and natural modes of the calibrated truck."""

from sysid.prediction.modes import calibrated_modes
from sysid.prediction.passes import predict, predict_pass, speed_sweep
from sysid.prediction.results import PassPrediction, Predictions, Quantiles, SpeedSweep

__all__ = [
    "PassPrediction",
    "Predictions",
    "Quantiles",
    "SpeedSweep",
    "calibrated_modes",
    "predict",
    "predict_pass",
    "speed_sweep",
]
