"""Mistakes of a campaign that a fit could show, one by one, as directions in which the simulated readings would move.

A wrong sign, a lag or a scale acts on the readings of one sensor: its direction needs no simulation.  The place of a
frame sensor or of an axle, and the load case of a run, take one simulation each, of all runs at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.arrays import Parameters
from sysid.campaign.records import Campaign, Sensor
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, signal_residuals
from sysid.wording import shorten

MistakeKind = Literal["sign", "lag", "clock", "scale", "frame place", "axle place", "load case"]
#: Steps of the differences: sign and load case are all or nothing, the others small against what they disturb.
_STEP: dict[MistakeKind, float] = {
    "sign": 1.0, "lag": 1e-3, "clock": 1e-3, "scale": 1e-2, "frame place": 0.1, "axle place": 0.05, "load case": 1.0,
}  # fmt: skip
#: Amplitudes that count as a mistake, in the unit of the kind (1, s, s, 1, m, m, 1): smaller ones are how sensors are
#: mounted, or departures of the model; larger ones are beyond what one linear step tells.
RANGE: dict[MistakeKind, tuple[float, float]] = {
    "sign": (0.6, 1.6),
    "lag": (0.003, 0.1),
    "clock": (0.003, 0.1),
    "scale": (0.06, 3.0),
    "frame place": (0.5, 10.0),
    "axle place": (0.08, 1.5),
    "load case": (0.6, 1.6),
}

Residuals = list[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Candidate:
    """One possible mistake: its kind, and the sensor, logger, axle (index), or run and load case that it is about."""

    kind: MistakeKind
    sensor: Sensor | None = None
    axle: int | None = None
    run: int | None = None
    load_case: str = ""
    logger: str = ""

    def possible(self, amplitude: float) -> bool:
        """Whether an amplitude is that of a mistake; all but signs and load cases go both ways, scales as factors."""
        low, high = RANGE[self.kind]
        if self.kind in ("sign", "load case"):
            return low <= amplitude <= high
        return low <= abs(amplitude) <= high and (self.kind != "scale" or amplitude > -0.9)

    def sentence(self, campaign: Campaign, amplitude: float) -> str:
        """What is probably wrong by how much, and the remedy; the sentence goes on behind "probably"."""
        if self.kind == "axle place":
            assert self.axle is not None
            axle = campaign.vehicle.axles[self.axle]
            return (
                f"the axle '{shorten(axle.name)}' is {100 * abs(amplitude):.0f} cm "
                f"{'behind' if amplitude > 0 else 'in front of'} its declared place (x_m = {axle.x_m + amplitude:.2f} "
                f"instead of {axle.x_m:g}): measure the distances between the axles"
            )
        if self.kind == "load case":
            assert self.run is not None
            run = campaign.bump_runs[self.run]
            return (
                f"{shorten(run.log.file, 100)} was driven in the load case '{shorten(self.load_case)}', not "
                f"'{shorten(run.load_case)}': correct its load_case, or check that this is the log of that run"
            )
        if self.kind == "clock":
            return (
                f"the readings of the logger '{shorten(self.logger)}' are {1e3 * abs(amplitude):.0f} ms "
                f"{'late' if amplitude > 0 else 'early'} against the others: check what check says of its clock"
            )
        return self._of_sensor(amplitude)

    def _of_sensor(self, amplitude: float) -> str:
        assert self.sensor is not None
        sensor, name = self.sensor, f"the sensor '{shorten(self.sensor.column)}'"
        if self.kind == "sign":
            return f"{name} has the wrong sign: look at its mounting, or set sign = {-sensor.sign} for it"
        if self.kind == "lag":
            return (
                f"{name} is {1e3 * abs(amplitude):.0f} ms {'late' if amplitude > 0 else 'early'}: check its filter, "
                "amplifier and logger"
            )
        if self.kind == "scale":
            return (
                f"{name} reads {1.0 + amplitude:.2f} times what it should: check its calibration, or set "
                f"scale = {sensor.scale / (1.0 + amplitude):.3g} for it"
            )
        assert sensor.x_m is not None
        return (
            f"{name} is at x_m = {sensor.x_m + amplitude:.1f}, not at {sensor.x_m:g}: correct its x_m, or check which "
            "sensor this column holds"
        )


@dataclass(frozen=True)
class Directions:
    """Derivatives of a fit's residuals by possible mistakes, under given weights."""

    campaign: Campaign
    model: BumpModel
    weights: Weights
    log_parameters: Parameters
    motion: RunMotion

    def __iter__(self) -> Iterator[tuple[Candidate, tuple[ResidualColumns, ...]]]:
        """Every candidate with one column per group; columns are made one simulation at a time."""
        base = simulate_runs(self.model, self.log_parameters, self.motion)
        here = signal_residuals(self.model, self.weights, base)
        yield from self._of_sensors(base, here)
        yield from self._of_frame_places(here)
        for axle in range(len(self.campaign.vehicle.axles)):
            moved = self._simulated(self._with_axle(axle, _STEP["axle place"]))
            yield Candidate("axle place", axle=axle), _columns(moved, here, _STEP["axle place"])
        yield from self._of_load_cases(here)

    def _simulated(self, trial: BumpModel) -> Residuals:
        return signal_residuals(self.model, self.weights, simulate_runs(trial, self.log_parameters, self.motion))

    def _of_sensors(
        self, base: Sequence[np.ndarray], here: Residuals
    ) -> Iterator[tuple[Candidate, tuple[ResidualColumns, ...]]]:
        sensors = self.model.layout.sensors
        loggers = sorted({s.logger for s in sensors} - {""})
        late = [
            y - _STEP["lag"] * np.gradient(y, g.interval_s, axis=0)
            for y, g in zip(base, self.model.groups, strict=True)
        ]
        changed: dict[MistakeKind, list[np.ndarray]] = {
            "sign": [-y for y in base],
            "scale": [(1.0 + _STEP["scale"]) * y for y in base],
            "lag": late,
        }
        for kind, signals in changed.items():
            columns = _columns(signal_residuals(self.model, self.weights, signals), here, _STEP[kind])
            for c, sensor in enumerate(sensors):
                yield Candidate(kind, sensor=sensor), _only(columns, channels=[c])
            for logger in loggers if kind == "lag" else ():
                of_logger = [c for c, s in enumerate(sensors) if s.logger == logger]
                yield Candidate("clock", logger=logger), _only(columns, channels=of_logger)

    def _of_frame_places(self, here: Residuals) -> Iterator[tuple[Candidate, tuple[ResidualColumns, ...]]]:
        layout = self.model.layout
        frames = [c for c, s in enumerate(layout.sensors) if s.kind == "body_acceleration"]
        if not frames:
            return
        step = _STEP["frame place"]
        moved = replace(
            layout,
            sensors=tuple(replace(s, x_m=(s.x_m or 0.0) + step) if c in frames else s
                          for c, s in enumerate(layout.sensors)),
        )  # fmt: skip
        trial = replace(self.model, layout=moved).with_vehicle(self.campaign.vehicle, self.campaign.load_cases)
        columns = _columns(self._simulated(trial), here, step)
        for c in frames:
            yield Candidate("frame place", sensor=layout.sensors[c]), _only(columns, channels=[c])

    def _with_axle(self, axle: int, step_m: float) -> BumpModel:
        vehicle = self.campaign.vehicle
        axles = tuple(replace(a, x_m=a.x_m + step_m) if i == axle else a for i, a in enumerate(vehicle.axles))
        trial = self.model.with_vehicle(replace(vehicle, axles=axles), self.campaign.load_cases)
        places = np.array([a.x_m for a in axles])[:, None]
        return replace(trial, arrays=tuple(a._replace(axle_x=places) for a in trial.arrays))

    def _of_load_cases(self, here: Residuals) -> Iterator[tuple[Candidate, tuple[ResidualColumns, ...]]]:
        runs = self.campaign.bump_runs
        driven = list(dict.fromkeys(r.load_case for r in runs))
        for other in driven if len(driven) > 1 else ():
            listed = replace(self.campaign, bump_runs=tuple(replace(r, load_case=other) for r in runs))
            trial = bump_model(
                listed, self.model.parameters, {}, target_step_s=self.model.target_step_s, tires=self.model.tires,
                roads=self.model.felt,
            )  # fmt: skip
            trial = replace(trial, shapes=self.model.shapes)
            columns = _columns(self._simulated(trial), here, _STEP["load case"])
            for r, run in enumerate(runs):
                if run.load_case != other and any(r in group.runs for group in self.model.groups):
                    of_run = [[i for i, k in enumerate(group.runs) if k == r] for group in self.model.groups]
                    yield Candidate("load case", run=r, load_case=other), _only(columns, runs=of_run)


def _columns(moved: Residuals, here: Residuals, step: float) -> tuple[ResidualColumns, ...]:
    return tuple(
        ResidualColumns(((a - b) / step)[..., None], ((c - d) / step)[..., None])
        for (a, c), (b, d) in zip(moved, here, strict=True)
    )


def _only(
    columns: Sequence[ResidualColumns],
    channels: Sequence[int] | None = None,
    runs: Sequence[Sequence[int]] | None = None,
) -> tuple[ResidualColumns, ...]:
    """The columns with zeros everywhere but in some channels, or in some runs of each group."""
    result = []
    for g, (residual, gain) in enumerate(columns):
        kept = np.zeros(gain.shape[:2], bool)
        if channels is not None:
            kept[:, list(channels)] = True
        if runs is not None:
            kept[list(runs[g])] = True
        result.append(ResidualColumns(residual * kept[..., None], gain * kept[..., None]))
    return tuple(result)
