"""All bump runs of a campaign, ready for simulation: arrays, shapes and roads of groups of runs of similar length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from sysid.arrays import Channels, Runs, SamplesByRunsByChannels
from sysid.campaign.records import AntiAliasFilter, Campaign
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.estimation.parameters.axle_laws import LawInputs, law_inputs
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.integration_step import TARGET_STEP_S
from sysid.estimation.residuals.run_data import ChannelLayout, RunGroup, channel_layout, group_runs
from sysid.estimation.residuals.run_motion import motion_prior
from sysid.road.contact_laws import ContactLaw
from sysid.road.road_profile import RoadProfile
from sysid.runtime import require_64_bit
from sysid.vehicle_model.contact import EffectiveRoad, RoadRise, raised_along
from sysid.vehicle_model.device_arrays import HostOrDevice
from sysid.vehicle_model.engine import Timing
from sysid.vehicle_model.filters import FilterRecursion, discretise
from sysid.vehicle_model.passes import (
    EffectiveRoads,
    MapTires,
    Pass,
    PassBatch,
    load_case_matrices,
    make_pass_batch,
    pass_matrices,
)
from sysid.vehicle_model.readings import Readings
from sysid.vehicle_model.simulation import SensorLayout
from sysid.vehicle_model.stacked_matrices import StackedMatrices

#: Standard deviation of a sensor's gain about its calibration: assumptions, no data sheet stands behind them.
GAIN_SD = {
    "suspension_deflection": 0.005,
    "bellows_extension": 0.5,  # from 0.12 to 0.5 m of height: its gain is not known
    "axle_acceleration": 0.01,
    "body_acceleration": 0.01,
    "pitch_rate": 0.01,
}


#: Kind of an unknown of left and right, index of its axle or body, load case, and bump or column.
SideKey: TypeAlias = tuple[str, int, str | None, str | None]


class GroupArrays(NamedTuple):
    """Arrays of one group of runs that an engine takes: model constants, data and weights.

    `measured` (T, R, C) square root of the weight of every plain reading, 0 where there is none; `change_unit` (R,)
    unit of the unknown change of speed, 0 where there is none.
    """

    matrices: StackedMatrices
    laws: LawInputs
    axle_x: np.ndarray
    value: SamplesByRunsByChannels
    measured: SamplesByRunsByChannels
    censored: SamplesByRunsByChannels
    gain_sd: Channels
    change_unit: Runs

    def readings(self, noise_sd: HostOrDevice, tempering: HostOrDevice) -> Readings:
        """Data of the runs with residual scale [SI] and tempering (R, C)."""
        return Readings(self.value, self.measured, self.censored, noise_sd, tempering, self.gain_sd)


class GroupShape(NamedTuple):
    """Which sensors a group of runs has, how its records are sampled, and the steps between samples (hashable)."""

    deflection_axles: tuple[int, ...]
    acceleration_axles: tuple[int, ...]
    interval_s: float
    substeps: int
    samples: int
    filter: AntiAliasFilter | None

    @property
    def timing(self) -> Timing:
        """Samples, their interval and integration steps per sample."""
        return Timing(self.samples, self.interval_s, self.substeps)

    @property
    def sensors(self) -> SensorLayout:
        """Which signals are observed."""
        return SensorLayout(self.deflection_axles, self.acceleration_axles)

    @property
    def recursion(self) -> FilterRecursion | None:
        """The anti-alias filter on the integration grid."""
        return None if self.filter is None else discretise(self.filter, self.interval_s / self.substeps)


@dataclass(frozen=True)
class BumpModel:
    """All bump runs of a campaign in groups, ready for an engine, with the parameters that drive them.

    - `passes` of every group;
    - `felt`: effective road of the wheels at every bump, by the contact law;
    - `tires` are those that footprint maps were made for, None for the declared ones;
    - `target_step_s`: the largest integration step [s];
    - `sides`: amounts by which left and right differ from usual, by kind, place, load case, and bump or column;
    - `rises`: what tires of unlike sides add to the mean road of every group, which `roads` have; none without roll.
    """

    parameters: ParameterSet
    layout: ChannelLayout
    groups: tuple[RunGroup, ...]
    arrays: tuple[GroupArrays, ...]
    roads: tuple[EffectiveRoad, ...]
    batches: tuple[PassBatch, ...]
    shapes: tuple[GroupShape, ...]
    passes: tuple[tuple[Pass, ...], ...]
    felt: EffectiveRoads
    target_step_s: float
    tires: MapTires | None = None
    sides: tuple[tuple[SideKey, float], ...] = ()
    rises: tuple[RoadRise, ...] = ()

    def on_roads(self, roads: Sequence[EffectiveRoad]) -> BumpModel:
        """The same runs on other roads, which are raised as those of the model."""
        if self.rises:
            roads = [raised_along(*pair) for pair in zip(roads, self.rises, strict=True)]
        return replace(self, roads=tuple(roads))

    def with_substeps(self, factor: int) -> BumpModel:
        """The same model with every sample interval cut into `factor` times as many steps."""
        shapes = tuple(s._replace(substeps=s.substeps * factor) for s in self.shapes)
        return replace(self, shapes=shapes)

    def part(self, position: int) -> BumpModel:
        """The model of the runs of one group alone."""
        one = slice(position, position + 1)
        return replace(
            self,
            groups=self.groups[one],
            arrays=self.arrays[one],
            roads=self.roads[one],
            batches=self.batches[one],
            shapes=self.shapes[one],
            passes=self.passes[one],
            rises=self.rises[one],
        )

    def with_vehicle(self, vehicle: Vehicle, load_cases: Mapping[str, LoadCase]) -> BumpModel:
        """The same runs of another vehicle: its matrices assembled again, what its wheels feel as before."""
        arrays, batches = [], []
        of_load_cases = load_case_matrices(vehicle, load_cases, (p for passes in self.passes for p in passes))
        for old, batch, passes in zip(self.arrays, self.batches, self.passes, strict=True):
            matrices = pass_matrices(of_load_cases, passes, self.layout.body_points, self.layout.rate_points)
            batch = replace(batch, matrices=matrices)
            laws = law_inputs(vehicle, self.parameters, batch, [p.load_case for p in passes])
            arrays.append(old._replace(matrices=matrices, laws=laws))
            batches.append(batch)
        return replace(self, arrays=tuple(arrays), batches=tuple(batches))


def bump_model(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    *,
    target_step_s: float = TARGET_STEP_S,
    contact: ContactLaw = "footprint",
    tires: MapTires | None = None,
    roads: EffectiveRoads | None = None,
) -> BumpModel:
    """Prepare all bump runs of a campaign for simulation.

    Parameters
    ----------
    campaign : screened campaign, SI.
    parameters : global parameters.
    profiles : road profile of each bump by name.
    target_step_s : largest integration step [s]; the step divides every run's sample interval.
    contact : contact law of all tires.
    tires : those that footprint maps are made for, None for the declared ones.
    roads : what the wheels feel, None for the contact law over `profiles`.

    Raises
    ------
    DataRejectedError
        If no run has a usable channel.
    SysidError
        If 64-bit floats are off.
    """
    require_64_bit()
    layout = channel_layout(campaign.bump_runs)
    groups = group_runs(campaign, layout)
    felt = roads or EffectiveRoads(campaign.vehicle, campaign.load_cases, profiles, contact, tires)
    gain_sd = np.array([GAIN_SD[s.kind] for s in layout.sensors])
    arrays, batches, shapes, group_passes = [], [], [], []
    for group in groups:
        runs = [campaign.bump_runs[i] for i in group.runs]
        passes = tuple(Pass(r.load_case, r.bump, r.speed_held, run=r.log.file) for r in runs)
        batch = make_pass_batch(
            campaign.vehicle, campaign.load_cases, felt, passes, layout.body_points, layout.rate_points
        )
        group_passes.append(passes)
        substeps = max(1, int(np.ceil(group.interval_s / target_step_s - 1e-9)))
        shapes.append(
            GroupShape(
                layout.deflection_axles,
                layout.acceleration_axles,
                group.interval_s,
                substeps,
                group.samples,
                campaign.acquisition.filter,
            )
        )
        batches.append(batch)
        arrays.append(
            GroupArrays(
                batch.matrices,
                law_inputs(campaign.vehicle, parameters, batch, [r.load_case for r in runs]),
                batch.axle_x,
                group.value,
                group.measured.astype(float),
                group.censored.astype(float),
                gain_sd,
                motion_prior(runs).change_sd,
            )
        )
    return BumpModel(
        parameters,
        layout,
        groups,
        tuple(arrays),
        tuple(batch.road for batch in batches),
        tuple(batches),
        tuple(shapes),
        tuple(group_passes),
        felt,
        target_step_s,
        tires,
    )
