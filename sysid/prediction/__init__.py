"""Wheel loads of passes that nobody drove."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.prediction.predict_passes import predict, predict_pass, speed_sweep
    from sysid.prediction.predicted_passes import PassPrediction, Predictions, Quantiles, SpeedSweep

_HOMES = {
    "PassPrediction": "sysid.prediction.predicted_passes",
    "Predictions": "sysid.prediction.predicted_passes",
    "Quantiles": "sysid.prediction.predicted_passes",
    "SpeedSweep": "sysid.prediction.predicted_passes",
    "predict": "sysid.prediction.predict_passes",
    "predict_pass": "sysid.prediction.predict_passes",
    "speed_sweep": "sysid.prediction.predict_passes",
}

__all__ = [
    "PassPrediction",
    "Predictions",
    "Quantiles",
    "SpeedSweep",
    "predict",
    "predict_pass",
    "speed_sweep",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
