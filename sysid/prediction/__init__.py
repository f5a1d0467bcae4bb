"""Wheel loads of passes nobody drove."""

from sysid.prediction.passes import predict, predict_pass
from sysid.prediction.results import PassPrediction, Predictions

__all__ = ["PassPrediction", "Predictions", "predict", "predict_pass"]
