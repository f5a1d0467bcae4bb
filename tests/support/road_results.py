"""A pass over a rough road with values made by hand."""

from __future__ import annotations

import numpy as np

from sysid.prediction.predicted_passes import PassPrediction, RoadLoads
from sysid.prediction.quantiles import Quantiles


def around(middle) -> Quantiles:
    middle = np.asarray(middle, float)
    return Quantiles(0.9 * middle, middle, 1.1 * middle)


def over_road(
    speed_m_s: float = 20.0, stress: float = 1.2, shape: str = "road class B, 100 m, seed 0"
) -> PassPrediction:
    time = 0.004 * np.arange(1500)
    force = 1e4 * np.array([5.0 + np.sin(10.0 * time), 8.0 + 2.0 * np.cos(8.0 * time)])
    frequency = np.linspace(0.0, 30.0, 241)
    road = RoadLoads(
        load_95_N=around([6e4, 9e4]),
        load_99_N=around([6.2e4, 9.5e4]),
        road_stress=around([1.1, 1.2]),
        vehicle_stress=around([stress]),
        aggregate_95=around([1.5]),
        exponent=4.0,
        length_m=100.0,
        realisations=1,
        roughness_index_mm_m=4.4,
        density_m3=64e-6,
        road_class="B",
        frequency_hz=frequency,
        spectrum_N2_Hz=around(1e6 / (1.0 + frequency**2) * np.array([[1.0], [2.0]])),
        range_levels=np.array([0.1, 0.5, 1.0]),
        tire_ranges_per_km=around([[100.0, 10.0, 0.0], [200.0, 20.0, 1.0]]),
        suspension_ranges_per_km=around([[50.0, 5.0, 0.0], [100.0, 10.0, 1.0]]),
        station_m=np.arange(0.0, 100.0, 0.25),
        aggregate_N=np.ones((400, 3)),
    )
    ratio = np.array([1.2, 1.25])
    return PassPrediction("laden", speed_m_s, time, 0.9 * force, force, 1.1 * force, np.array([5e4, 8e4]), ratio, ratio,
                          ratio, np.zeros(2, bool), shape=shape, road=road)  # fmt: skip
