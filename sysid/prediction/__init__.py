"""Wheel loads of passes that nobody drove."""

from sysid.prediction.predict_passes import predict, predict_pass, speed_sweep
from sysid.prediction.predicted_passes import PassPrediction, Predictions, Quantiles, SpeedSweep

__all__ = [
    "PassPrediction",
    "Predictions",
    "Quantiles",
    "SpeedSweep",
    "predict",
    "predict_pass",
    "speed_sweep",
]
