from .predict_passes import predict as predict
from .predict_passes import predict_pass as predict_pass
from .predict_passes import speed_sweep as speed_sweep
from .predicted_passes import PassPrediction as PassPrediction
from .predicted_passes import Predictions as Predictions
from .predicted_passes import Quantiles as Quantiles
from .predicted_passes import RoadLoads as RoadLoads
from .predicted_passes import SpeedSweep as SpeedSweep
