"""Mistakes of a campaign that a fit could show, one by one, as directions in which the simulated readings would move.

A wrong sign, a lag or a scale acts on the readings of one sensor: its direction needs no simulation.  The place of a
frame sensor or of an axle, and the load case of a run, take one simulation each, of all runs at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from sysid.arrays import Parameters
from sysid.campaign.records import Campaign, Sensor
from sysid.campaign.vehicle_records import FrameBending
from sysid.estimation.fit.causes import CauseKind
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, signal_residuals
from sysid.wording import shorten

MistakeKind = Literal["sign", "lag", "clock", "scale", "frame place", "axle place", "load case", "own springs"]
#: Sizes that are tried, in the unit of the kind (s, 1, m). The best of them is the direction of the test, with its full
#: size, because a step of 20 ms or 0.3 m is not linear in the residuals. Smaller sizes are usual mounting errors of
#: sensors, or departures of the model.
_TRIED: dict[MistakeKind, tuple[float, ...]] = {
    "lag": tuple(1e-3 * k for k in (3, 4, 5, 7, 10, 14, 20, 28, 40, 60)),
    "scale": (0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 0.9, 1.5, 2.5),
    "frame place": (0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.5, 7.0),
    "axle place": (0.1, 0.2, 0.4),
}
#: Mass [kg] that is tried on springs of its own, frequencies [Hz] and damping ratio on these: cabs and engines of
#: trucks (assumptions).  What it does grows in proportion, so it may be any share of the body's mass between these.
_PART_KG, _PART_HZ, _PART_RATIO = 50.0, (1.2, 1.6, 2.1, 2.8, 3.7, 5.0), 0.15
_ANY: dict[MistakeKind, tuple[float, float]] = {"own springs": (0.01, 0.5)}
_CAUSES: dict[MistakeKind, CauseKind] = {
    "sign": "sensor",
    "lag": "sensor",
    "scale": "sensor",
    "clock": "clock",
    "frame place": "place",
    "axle place": "place",
    "load case": "load_case",
    "own springs": "own_springs",
}
#: Range of the linear step, as a fraction of such a direction, that counts as the full mistake: it is either there or
#: not.
WHOLE = (0.5, 1.5)
#: Step of the derivative of frame readings by place [m].
_PLACE_STEP_M = 0.1

Residuals = list[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class MistakeCandidate:
    """One possible mistake: its kind, its `size` in the unit of the kind (lag and clock s, scale 1 more, places m, part
    on own springs as share of its body), and the sensor, logger, axle (index), or run and load case that it is about; a
    part on springs of its own is in a `body` (index), over `axle`, at a frequency `hz`.
    """

    kind: MistakeKind
    size: float = 1.0
    sensor: Sensor | None = None
    axle: int | None = None
    run: int | None = None
    load_case: str = ""
    logger: str = ""
    body: int = 0
    hz: float = 0.0

    @property
    def cause(self) -> CauseKind:
        """The kind of cause that this mistake is."""
        return _CAUSES[self.kind]

    def is_whole(self, amplitude: float) -> bool:
        """Whether a linear step of so many times the size goes about as far as the full mistake, or as one may."""
        if self.kind in _ANY:
            least, most = _ANY[self.kind]
            return least <= amplitude * self.size <= most
        return WHOLE[0] <= amplitude <= WHOLE[1]

    def at(self, amplitude: float) -> MistakeCandidate:
        """The candidate with the size that a linear step finds, where its kind may have any."""
        return replace(self, size=self.size * amplitude) if self.kind in _ANY else self

    def sentence(self, campaign: Campaign) -> str:
        """What is probably wrong and by how much, and the remedy: the part of the sentence after "probably"."""
        if self.kind == "axle place":
            assert self.axle is not None
            axle = campaign.vehicle.axles[self.axle]
            return (
                f"the axle '{shorten(axle.name)}' is about {100 * abs(self.size):.0f} cm "
                f"{'behind' if self.size > 0 else 'in front of'} its declared place (x_m = {axle.x_m + self.size:.1f} "
                f"instead of {axle.x_m:g}): measure the distances between the axles"
            )
        if self.kind == "load case":
            assert self.run is not None
            run = campaign.bump_runs[self.run]
            return (
                f"{shorten(run.log.file, 100)} was driven in the load case '{shorten(self.load_case)}', not "
                f"'{shorten(run.load_case)}': correct its load_case, or check that this is the log of that run"
            )
        if self.kind == "own springs":
            assert self.axle is not None
            name = campaign.vehicle.bodies[self.body].name
            return (
                f"a part of the body '{shorten(name)}' stands on springs of its own near axle {self.axle + 1}, about "
                f"{100.0 * self.size:.2g} % of its mass at {self.hz:.1f} Hz: a cab, an engine or cargo. The model has "
                "no such part; lock it for the test, or expect errors of k and c there"
            )
        if self.kind == "clock":
            return (
                f"the readings of the logger '{shorten(self.logger)}' are {1e3 * abs(self.size):.0f} ms "
                f"{'late' if self.size > 0 else 'early'} against the others: look at its clock in the output of check"
            )
        return self._of_sensor()

    def _of_sensor(self) -> str:
        assert self.sensor is not None
        sensor, name = self.sensor, f"the sensor '{shorten(self.sensor.column)}'"
        if self.kind == "sign":
            return f"{name} has the wrong sign: look at its mounting, or set sign = {-sensor.sign} for it"
        if self.kind == "lag":
            return (
                f"{name} is {1e3 * abs(self.size):.0f} ms {'late' if self.size > 0 else 'early'}: check its filter, "
                "amplifier and logger"
            )
        if self.kind == "scale":
            return (
                f"{name} reads {1.0 + self.size:.2f} times what it should: check its calibration, or set "
                f"scale = {sensor.scale / (1.0 + self.size):.3g} for it"
            )
        assert sensor.x_m is not None
        return (
            f"{name} is at x_m = {sensor.x_m + self.size:.1f}, not at {sensor.x_m:g}: correct its x_m, or check which "
            "sensor this column holds"
        )


@dataclass(frozen=True)
class Directions:
    """Changes of a fit's residuals by possible mistakes, under given weights."""

    campaign: Campaign
    model: BumpModel
    weights: Weights
    log_parameters: Parameters
    motion: RunMotion

    def __iter__(self) -> Iterator[tuple[MistakeCandidate, tuple[ResidualColumns, ...]]]:
        """Every candidate and a column per group: residuals with the mistake corrected, less the present ones."""
        base = simulate_runs(self.model, self.log_parameters, self.motion)
        here = signal_residuals(self.model, self.weights, base)
        yield from self._of_sensors(base, here)
        yield from self._of_axles(here)
        yield from self._of_load_cases(here)
        yield from self._of_own_springs(here)

    def _of_own_springs(self, here: Residuals) -> Iterator[tuple[MistakeCandidate, tuple[ResidualColumns, ...]]]:
        vehicle, cases = self.campaign.vehicle, self.campaign.load_cases
        for axle, hz in product(range(len(vehicle.axles)), _PART_HZ):
            body = vehicle.axles[axle].body
            whole = next(iter(cases.values())).sprung_mass_kg[body]
            if vehicle.bodies[body].bending is not None:
                continue
            part = FrameBending(hz, _PART_RATIO, own_mass=(_PART_KG, vehicle.axles[axle].x_m))
            bodies = tuple(replace(b, bending=part) if i == body else b for i, b in enumerate(vehicle.bodies))
            trial = self.model.with_vehicle(replace(vehicle, bodies=bodies), cases)
            candidate = MistakeCandidate("own springs", _PART_KG / whole, axle=axle, body=body, hz=hz)
            yield candidate, _columns(self._simulated(trial), here)

    def _simulated(self, trial: BumpModel) -> Residuals:
        return signal_residuals(self.model, self.weights, simulate_runs(trial, self.log_parameters, self.motion))

    def _of_sensors(
        self, base: Sequence[np.ndarray], here: Residuals
    ) -> Iterator[tuple[MistakeCandidate, tuple[ResidualColumns, ...]]]:
        """Signs, lags, scales and places of frame sensors, and the clocks of loggers."""
        sensors = self.model.layout.sensors
        kinds: list[tuple[MistakeKind, Sequence[float]]] = [("sign", (1.0,)), ("scale", (*_both("scale"),))]
        kinds += [("lag", _both("lag")), ("frame place", _both("frame place"))]
        slopes = self._by_place(base)
        for kind, sizes in kinds:
            chosen = [c for c, s in enumerate(sensors) if kind != "frame place" or s.kind == "body_acceleration"]
            sets = [[c] for c in chosen]
            loggers = sorted({s.logger for s in sensors} - {""}) if kind == "lag" else []
            sets += [[c for c, s in enumerate(sensors) if s.logger == name] for name in loggers]
            best: list[tuple[float, float, tuple[ResidualColumns, ...]]] = [(np.inf, 0.0, ())] * len(sets)
            for size in sizes:
                signals = [self._changed(kind, size, g, base[g], slopes[g]) for g in range(len(base))]
                moved = signal_residuals(self.model, self.weights, signals)
                for k, channels in enumerate(sets):
                    left = sum(float(np.sum(r[:, :, channels] ** 2) + np.sum(g[:, channels] ** 2)) for r, g in moved)
                    if left < best[k][0]:
                        best[k] = left, size, _only(_columns(moved, here), channels=channels)
            for k, (_, size, columns) in enumerate(best):
                if not columns:
                    continue
                if k < len(chosen):
                    yield MistakeCandidate(kind, size, sensor=sensors[chosen[k]]), columns
                else:
                    yield MistakeCandidate("clock", size, logger=loggers[k - len(chosen)]), columns

    def _changed(self, kind: MistakeKind, size: float, group: int, shown: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Signals (T, R, C) of a group with all sensors wrong in one way."""
        if kind == "sign":
            return -shown
        if kind == "scale":
            return (1.0 + size) * shown
        if kind == "frame place":
            return shown + size * slope
        interval = self.model.groups[group].interval_s
        at = np.arange(shown.shape[0]) - size / interval
        whole = np.clip(np.floor(at).astype(int), 0, shown.shape[0] - 2)
        part = np.clip(at - whole, 0.0, 1.0)[:, None, None]
        return np.asarray((1.0 - part) * shown[whole] + part * shown[whole + 1])

    def _by_place(self, base: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Derivatives (T, R, C) of the frame sensors' signals by their place [per m], zero for others."""
        layout = self.model.layout
        sensors = tuple(
            replace(s, x_m=(s.x_m or 0.0) + _PLACE_STEP_M) if s.kind == "body_acceleration" else s
            for s in layout.sensors
        )
        if sensors == layout.sensors:
            return [np.zeros_like(y) for y in base]
        trial = replace(self.model, layout=replace(layout, sensors=sensors))
        trial = trial.with_vehicle(self.campaign.vehicle, self.campaign.load_cases)
        moved = simulate_runs(trial, self.log_parameters, self.motion)
        return [(a - b) / _PLACE_STEP_M for a, b in zip(moved, base, strict=True)]

    def _of_axles(self, here: Residuals) -> Iterator[tuple[MistakeCandidate, tuple[ResidualColumns, ...]]]:
        for axle in range(len(self.campaign.vehicle.axles)):
            for size in _both("axle place"):
                moved = self._simulated(self._with_axle(axle, size))
                yield MistakeCandidate("axle place", size, axle=axle), _columns(moved, here)

    def _with_axle(self, axle: int, step_m: float) -> BumpModel:
        vehicle = self.campaign.vehicle
        axles = tuple(replace(a, x_m=a.x_m + step_m) if i == axle else a for i, a in enumerate(vehicle.axles))
        trial = self.model.with_vehicle(replace(vehicle, axles=axles), self.campaign.load_cases)
        places = np.array([a.x_m for a in axles])[:, None]
        return replace(trial, arrays=tuple(a._replace(axle_x=places) for a in trial.arrays))

    def _of_load_cases(self, here: Residuals) -> Iterator[tuple[MistakeCandidate, tuple[ResidualColumns, ...]]]:
        runs = self.campaign.bump_runs
        # A stiffness of its own per load case is known for those that were driven.
        per_load_case = any(axle.load_dependent for axle in self.campaign.vehicle.axles)
        for other in self.campaign.load_cases_in_use if per_load_case else self.campaign.load_cases:
            if all(run.load_case == other for run in runs):
                continue
            listed = replace(self.campaign, bump_runs=tuple(replace(r, load_case=other) for r in runs))
            trial = bump_model(
                listed,
                self.model.parameters,
                {},
                target_step_s=self.model.target_step_s,
                tires=self.model.tires,
                roads=self.model.felt,
            )
            columns = _columns(self._simulated(replace(trial, shapes=self.model.shapes)), here)
            for r, run in enumerate(runs):
                if run.load_case != other and any(r in group.runs for group in self.model.groups):
                    of_run = [[i for i, k in enumerate(group.runs) if k == r] for group in self.model.groups]
                    yield MistakeCandidate("load case", run=r, load_case=other), _only(columns, runs=of_run)


def _both(kind: MistakeKind) -> tuple[float, ...]:
    """Sizes to both sides; a scale of 1 + s also as 1 / (1 + s)."""
    other = [-s / (1.0 + s) if kind == "scale" else -s for s in _TRIED[kind]]
    return (*_TRIED[kind], *other)


def _columns(moved: Residuals, here: Residuals) -> tuple[ResidualColumns, ...]:
    pairs = zip(moved, here, strict=True)
    return tuple(ResidualColumns((a - b)[..., None], (c - d)[..., None]) for (a, c), (b, d) in pairs)


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
