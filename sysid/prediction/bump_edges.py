"""Bumps with edges: the springs of the tires are followed about the paths of the wheels at the speed of the pass."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sysid.arrays import Samples
from sysid.campaign.records import PredictionRequest
from sysid.estimation.fit.state import FitState
from sysid.prediction.assumed_stops import AssumedStops
from sysid.prediction.vehicle_draws import VehicleDraws
from sysid.prediction.vehicle_groups import hold_s, vehicle_groups
from sysid.road.wheel_paths import WheelPaths, followed
from sysid.vehicle_model.engine import Timing
from sysid.vehicle_model.passes import EDGES, EffectiveRoads, Pass

#: Integration step of the paths, and how long they go on behind the bump [s]: the wheels hop there.
_STEP_S, _AFTER_S = 0.001, 0.3


def driven_over_edges_m_s(state: FitState) -> float:
    """Largest nominal speed of the runs over bumps with edges [m/s], 0 without such runs."""
    runs, felt = state.campaign.bump_runs, state.model.felt
    harsh = {key for key in {(r.load_case, r.bump) for r in runs} if felt.off_springs(Pass(*key)) > EDGES}
    return max((r.nominal_speed_m_s for r in runs if (r.load_case, r.bump) in harsh), default=0.0)


@dataclass(frozen=True)
class BumpEdges:
    """What the wheels feel of bumps in every pass: `roads` over smooth ones, followed springs over edges.

    Paths are those of the optimum, so that one pass is the same whatever else is predicted.
    """

    state: FitState
    roads: EffectiveRoads
    stops: AssumedStops | None
    _known: dict[tuple[str, str, float], EffectiveRoads] = field(default_factory=dict, repr=False)

    def at(self, request: PredictionRequest) -> EffectiveRoads:
        """Roads of one pass over a bump."""
        driven = Pass(request.load_case, request.bump)
        if self.roads.off_springs(driven) <= EDGES:
            return self.roads
        key = (request.load_case, request.bump, request.speed_m_s)
        if key not in self._known:
            self._known[key], _ = followed(
                self.roads,
                lambda roads: self._paths(roads, request),
                lambda paths: self.roads.about(driven, paths),
            )
        return self._known[key]

    def vehicles(
        self, drawn: VehicleDraws | None, felt: EffectiveRoads, request: PredictionRequest
    ) -> VehicleDraws | None:
        """The vehicles of all draws in one pass over what the wheels feel of a bump."""
        if drawn is None or felt is self.roads:
            return drawn
        return drawn.over(felt).over_edges(request.speed_m_s, driven_over_edges_m_s(self.state))

    def _paths(self, roads: EffectiveRoads, request: PredictionRequest) -> WheelPaths:
        """Where the wheels of the optimum come over the bump."""
        speed, x = request.speed_m_s, np.array([axle.x_m for axle in roads.vehicle.axles])
        road = roads.stacked([Pass(request.load_case, request.bump)])
        first, last = road.first_station_m, road.first_station_m + road.step_m * road.rise.shape[-1]
        lead_s = _STEP_S * np.ceil(max(-first, 0.0) / speed / _STEP_S)
        samples = int(np.ceil((lead_s + (last + x.max()) / speed + _AFTER_S) / _STEP_S))
        optimum = self.state.point.log_parameters[None]
        _, (group,) = vehicle_groups(self.state, request.load_case, road, optimum, None, self.stops, hold_s(speed))
        driven = group.driven(road, x, speed, float(lead_s), Timing(samples, _STEP_S, 1))
        time: Samples = _STEP_S * np.arange(samples) - lead_s
        return group.wheels(driven, speed * time[:, None] - x)
