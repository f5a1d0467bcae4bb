"""A pass over a road or a bridge from what its draws reached: bands, peaks, and what goes beyond the driven runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid.arrays import SamplesByAxlesBySets
from sysid.campaign.records import Campaign, PredictionRequest
from sysid.prediction.assumed_stops import AssumedStops
from sysid.prediction.measures import quantiles
from sysid.prediction.predicted_passes import PassPrediction
from sysid.prediction.remarks import remarks
from sysid.prediction.trust import DrivenRange, Reached, extrapolations


def pass_over_road(
    campaign: Campaign,
    request: PredictionRequest,
    time_s: np.ndarray,
    force_N: SamplesByAxlesBySets,
    measured: Mapping[str, np.ndarray],
    static_N: np.ndarray,
    driven: DrivenRange,
    stops: AssumedStops | None,
    said: Sequence[str],
    **own: Any,
) -> PassPrediction:
    """The predicted pass of all draws.

    Parameters
    ----------
    time_s, force_N : (T,) [s], and tire forces (T, na, n) [N] of the draws behind the bands.
    measured : by name (na, n): extremes as :func:`sysid.prediction.measures.extremes` names them, `most` and `least`
        tire force [N], `mean_ratio` of the force over the static load of the draw; (1, n) `sum_ratio`, of all axles.
    static_N : (na,) static loads [N]; driven : what the driven runs reached; stops : those that are assumed.
    said : what else has to be known; own : further fields of :class:`PassPrediction`.
    """
    force, ratio = quantiles(force_N), quantiles(measured["most"] / static_N[:, None])
    names = ("tire_deflection_m", "jounce_m", "rebound_m", "damper_speed_m_s", "lift_off_s")
    reached = Reached(request.speed_m_s, **{n: np.median(measured[n], axis=-1) for n in names})
    acting = {} if stops is None else stops.acting(measured["jounce_m"], measured["rebound_m"])
    trust = extrapolations(reached, driven, request.load_case, acting)
    together = float(np.median(measured["sum_ratio"]))
    return PassPrediction(
        load_case=request.load_case,
        speed_m_s=request.speed_m_s,
        time_s=np.round(time_s, 6),
        tire_force_q05_N=None if force.q05 is None else force.q05.T,
        tire_force_q50_N=force.q50.T,
        tire_force_q95_N=None if force.q95 is None else force.q95.T,
        static_load_N=static_N,
        peak_ratio_q05=ratio.q05,
        peak_ratio_q50=ratio.q50,
        peak_ratio_q95=ratio.q95,
        lift_off=(measured["least"] <= 0.0).mean(axis=1) >= 0.5,
        warnings=(*remarks(campaign, request, trust, together, acting), *said),
        lift_off_s=quantiles(measured["lift_off_s"]),
        jounce_m=quantiles(measured["jounce_m"]),
        rebound_m=quantiles(measured["rebound_m"]),
        impulse_ratio=quantiles(measured["mean_ratio"]),
        shape=request.bump,
        trust=trust,
        **own,
    )
