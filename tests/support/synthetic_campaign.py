"""Complete synthetic campaign folders for any vehicle, made with the package's own model as the truck.

    python -m tests.support.synthetic_campaign --vehicle rigid3 --output build/rigid3

writes campaign.toml, plank drops, bump runs, a laser scan, and truth.toml with what stands behind them.  Every random
number follows from the seed.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, fields, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import jax
import jax.numpy as jnp
import numpy as np
from campaign_files import campaign_text, sensor_columns, truth_text, write_log, write_scan
from vehicles import NAMES, ExampleVehicle, example_vehicle

from sysid.campaign.records import Acquisition, AntiAliasFilter, BumpRun, Campaign, Log, PredictionRequest
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.estimation.parameters.axle_laws import axle_laws, law_inputs
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.road.road_profile import RoadProfile
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.engine import wheel_road
from sysid.vehicle_model.engines.protocol import Timing
from sysid.vehicle_model.filters import discretise
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.passes import EffectiveRoads, Pass, make_pass_batch
from sysid.vehicle_model.simulation import SensorLayout


@dataclass(frozen=True)
class Physics:
    """What the synthetic truck is and how it was measured; defaults are an ordinary campaign.

    `vehicle` names a file of `tests/data/vehicles`; `bump_shape` is ``cosine``, ``parabola`` or ``table``;
    `speeds_km_h` are driven in every load case, `repeats` times.  `suspension_law` is the law behind the logs and the
    one that campaign.toml declares, unless `declared_law` gives another; empty means linear.  Standard deviations
    (of logarithms where they spread a quantity): `unsprung_spread` and `inertia_spread` of masses about the declared
    ones, sums kept; `parameter_spread` of k, c, kt, ct about those of the vehicle file; `element_spread` of the other
    parameters of the law about their priors; `speed_spread`; noise, offset and gain of the sensors.
    `start_s` is the range of the moment at which axle 1 reaches the bump; `record_s` the length of every record of a
    run, 0 for one that ends when the truck has come to rest.
    """

    vehicle: str = "rigid3"
    seed: int = 1
    sample_interval_s: float = 0.005
    bump_shape: str = "cosine"
    bump_height_m: float = 0.075
    bump_length_m: float = 0.9
    scan_points: int = 20_000
    scan_noise_m: float = 0.0015
    speeds_km_h: tuple[float, ...] = (9.0, 16.0, 24.0)
    repeats: int = 1
    start_s: tuple[float, float] = (0.7, 1.7)
    record_s: float = 0.0
    drops_per_axle: int = 2
    plank_height_m: float = 0.075
    tire_exponent: float = 1.2
    suspension_law: str = ""
    declared_law: str = ""
    unsprung_spread: float = 0.0
    inertia_spread: float = 0.0
    parameter_spread: float = 0.0
    element_spread: float = 0.0
    speed_spread: float = 0.015
    filter_order: int = 4
    deflection_noise_m: float = 2.5e-4
    axle_noise_m_s2: float = 0.25
    body_noise_m_s2: float = 0.15
    offset_in_noises: float = 6.0
    gain_spread: float = 0.003
    deflection_range_m: float = 0.15
    axle_range_g: float = 10.0
    body_range_g: float = 5.0

    @property
    def filter(self) -> AntiAliasFilter | None:
        """Anti-alias filter at 0.3 of the sampling rate, None for order 0."""
        cutoff = 0.3 / self.sample_interval_s
        return AntiAliasFilter("butterworth", self.filter_order, cutoff) if self.filter_order else None


@dataclass(frozen=True)
class TrueVehicle:
    """The truck itself: masses may differ from the declared ones; `values` by parameter name."""

    vehicle: Vehicle
    load_cases: dict[str, LoadCase]
    parameters: ParameterSet
    values: dict[str, float]


#: Integration step of the truth [s], far finer than that of a fit, and how long a record goes on after the last axle.
STEP_S = 0.0005
RINGING_S = 2.5
#: The plank: ramp up, top and a sharp edge; rolled over slowly.
PLANK_RAMP_M, PLANK_TOP_M, PLANK_SPEEDS_M_S = 1.5, 1.2, (0.9, 1.6)
DROP_BEFORE_S, DROP_AFTER_S = 0.8, 3.6


def bump_height(physics: Physics, station: np.ndarray) -> np.ndarray:
    """Height [m] of the bump at stations [m] from its middle."""
    s = 2.0 * station / physics.bump_length_m
    shapes = {
        "cosine": 0.5 * (1.0 + np.cos(np.pi * np.clip(s, -1.0, 1.0))),
        "parabola": np.maximum(1.0 - s**2, 0.0),
        "table": np.clip(3.0 * (1.0 - np.abs(s)), 0.0, 1.0),
    }
    return physics.bump_height_m * shapes[physics.bump_shape]


def _profile(name: str, station: np.ndarray, height: np.ndarray) -> RoadProfile:
    above = station[height > 1e-3]
    return RoadProfile(name, station, height, 0.0 * height, float(above[0]), float(above[-1] - above[0]))


def bump_profile(physics: Physics) -> RoadProfile:
    """The true profile of the bump."""
    half = 0.5 * physics.bump_length_m
    station = np.arange(round((2 * half + 1.0) / 0.005) + 1) * 0.005
    return _profile("bump", station, bump_height(physics, station - half - 0.5))


def plank_profile(physics: Physics) -> RoadProfile:
    """A plank with a smooth ramp in front and a sharp edge behind, over which the axle drops."""
    station = np.arange(round((0.3 + PLANK_RAMP_M + PLANK_TOP_M + 0.3) / 0.005) + 1) * 0.005
    ramp = np.clip((station - 0.3) / PLANK_RAMP_M, 0.0, 1.0)
    up = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    return _profile("plank", station, physics.plank_height_m * up * (station < 0.3 + PLANK_RAMP_M + PLANK_TOP_M))


def true_vehicle(example: ExampleVehicle, physics: Physics, rng: np.random.Generator) -> TrueVehicle:
    """Masses and parameters behind the logs."""
    law = physics.suspension_law or None
    factors = np.exp(physics.unsprung_spread * rng.normal(size=len(example.vehicle.axles)))
    axles = tuple(
        replace(a, unsprung_mass_kg=a.unsprung_mass_kg * f, suspension_law=law)
        for a, f in zip(example.vehicle.axles, factors, strict=True)
    )
    vehicle = replace(example.vehicle, axles=axles)
    change = np.zeros(len(vehicle.bodies))
    for declared, true in zip(example.vehicle.axles, axles, strict=True):
        change[true.body] += declared.unsprung_mass_kg - true.unsprung_mass_kg
    turned = np.exp(physics.inertia_spread * rng.normal(size=change.size))
    cases = {
        name: replace(
            c,
            sprung_mass_kg=tuple(np.array(c.sprung_mass_kg) + change),
            pitch_inertia_kg_m2=tuple(np.array(c.pitch_inertia_kg_m2) * turned),
        )
        for name, c in example.load_cases.items()
    }
    runs = tuple(BumpRun("", name, 1.0, 1, Log("", physics.sample_interval_s, ())) for name in cases)
    parameters = campaign_parameters(records(vehicle, cases, runs, physics), None)
    return TrueVehicle(vehicle, cases, parameters, _values(example, physics, parameters, rng))


def _values(
    example: ExampleVehicle, physics: Physics, parameters: ParameterSet, rng: np.random.Generator
) -> dict[str, float]:
    behind, first = example.behind, next(iter(example.load_cases))
    own = {"damping": behind.damping, "tire_stiffness": behind.tire_stiffness, "tire_damping": behind.tire_damping}
    spread: dict[tuple[str, int | None], float] = {}
    found = {}
    for p in parameters.parameters:
        # One factor per axle and quantity, so that the load cases of an air spring stay together.
        factor = spread.setdefault((p.quantity, p.axle), float(rng.normal()))
        if p.quantity == "tire_exponent":
            found[p.name] = physics.tire_exponent
        elif p.quantity == "stiffness":
            found[p.name] = behind.stiffness[p.load_case or first][p.axle] * np.exp(physics.parameter_spread * factor)
        elif p.quantity in own:
            found[p.name] = own[p.quantity][p.axle] * np.exp(physics.parameter_spread * factor)
        else:
            found[p.name] = p.prior_median * np.exp(physics.element_spread * factor)
    return {name: float(value) for name, value in found.items()}


def records(vehicle: Vehicle, cases: dict[str, LoadCase], runs: tuple[BumpRun, ...], physics: Physics) -> Campaign:
    """Records of a campaign without logs."""
    return Campaign(
        title="synthetic",
        notes="",
        folder=Path(),
        file=Path("campaign.toml"),
        vehicle=vehicle,
        load_cases=cases,
        acquisition=Acquisition(physics.sample_interval_s, physics.filter),
        plank_drops=(),
        bump_runs=runs,
        scans={},
        predictions=(PredictionRequest(next(iter(cases)), 1.0),),
        input_sha256={},
    )


class Simulator:
    """Filtered readings of passes of one vehicle, all of one length."""

    def __init__(self, truth: TrueVehicle, physics: Physics, profile: RoadProfile, samples: int) -> None:
        self._truth = truth
        self._bump, self._interval = profile.name, physics.sample_interval_s
        axles = tuple(range(len(truth.vehicle.axles)))
        self._layout = SensorLayout(axles, axles)
        self._x = np.array([truth.values[name] for name in truth.parameters.names])
        tires = map_tires(truth.parameters, np.log(self._x))
        self._roads = EffectiveRoads(truth.vehicle, truth.load_cases, {profile.name: profile}, tires=tires)
        substeps = max(1, round(self._interval / STEP_S))
        self._timing = Timing(samples, self._interval, substeps)
        low_pass = physics.filter
        self._recursion = None if low_pass is None else discretise(low_pass, self._interval / substeps)

    def readings(self, load_case: str, speed_m_s: float, start_s: float, only_axle: int | None = None) -> np.ndarray:
        """(T, 3 na) deflections, axle and body accelerations above the axles [SI]; `only_axle` alone meets the bump."""
        vehicle = self._truth.vehicle
        points = [(a.body, a.x_m) for a in vehicle.axles]
        batch = make_pass_batch(vehicle, self._truth.load_cases, self._roads, [Pass(load_case, self._bump)], points)
        road = batch.road if only_axle is None else _only(batch.road, only_axle)
        laws = law_inputs(vehicle, self._truth.parameters, batch, [load_case])
        motion = Motion(*(np.full((1, 1), v) for v in (speed_m_s, start_s)))
        wheels = wheel_road(batch.matrices, road, batch.axle_x, motion, self._timing)
        suspension, tire = axle_laws(laws, jnp.log(self._x)[:, None])
        more = (self._timing, self._layout, self._recursion)
        shown = wheels.engine.sensors(batch.matrices, suspension, tire, wheels, *more)
        return np.asarray(shown)[:, 0, :, 0]


def _only(road: EffectiveRoad, axle: int) -> EffectiveRoad:
    """The road of one axle; under all others it is flat."""

    def kept(table: np.ndarray) -> np.ndarray:
        mask = np.zeros(table.shape[-2])
        mask[axle] = 1.0
        return table * mask[:, None]

    assert road.stretch is not None
    assert road.drag is not None
    return replace(road, rise=kept(road.rise), stretch=kept(road.stretch), drag=kept(road.drag))


def measured(clean: np.ndarray, kinds: list[str], physics: Physics, rng: np.random.Generator) -> np.ndarray:
    """Readings (T, C) with gain error, offset, noise and clipping [SI]."""
    noise = {"lvdt": physics.deflection_noise_m, "axle": physics.axle_noise_m_s2, "frame": physics.body_noise_m_s2}
    limit = {"lvdt": physics.deflection_range_m, "axle": 9.80665 * physics.axle_range_g}
    limit["frame"] = 9.80665 * physics.body_range_g
    sd, largest = (np.array([d[k] for k in kinds]) for d in (noise, limit))
    gain = 1.0 + physics.gain_spread * rng.normal(size=sd.size)
    offset = physics.offset_in_noises * sd * rng.uniform(-1.0, 1.0, sd.size)
    return np.clip(gain * clean + offset + sd * rng.normal(size=clean.shape), -largest, largest)


def write_campaign(folder: Path, physics: Physics) -> TrueVehicle:
    """Write the whole campaign folder; returns the truth behind it."""
    rng = np.random.default_rng(physics.seed)
    example = example_vehicle(physics.vehicle)
    truth = true_vehicle(example, physics, rng)
    (folder / "bump_runs").mkdir(parents=True, exist_ok=True)
    (folder / "plank_drops").mkdir(exist_ok=True)
    profile = bump_profile(physics)
    half = 0.5 * physics.bump_length_m
    write_scan(
        folder / "bump_scan.csv",
        lambda s: bump_height(physics, s),
        half,
        physics.scan_points,
        physics.scan_noise_m,
        rng,
    )
    runs = _write_runs(folder, physics, truth, profile, rng)
    drops = _write_drops(folder, physics, truth, rng)
    text = campaign_text(example, physics, runs, drops)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    (folder / "truth.toml").write_text(truth_text(truth, physics, runs, drops), encoding="utf-8")
    return truth


@dataclass(frozen=True)
class Made:
    """One log that was written: `label` is the load case of a run and the axle name of a drop; SI."""

    file: str
    label: str
    nominal_km_h: float
    repeat: int
    speed_m_s: float
    start_s: float


def _write_runs(folder: Path, physics: Physics, truth: TrueVehicle, profile: RoadProfile, rng) -> list[Made]:
    last = truth.vehicle.axles[-1].x_m + physics.bump_length_m
    length = [physics.record_s or physics.start_s[1] + last / (v / 3.6) + RINGING_S for v in physics.speeds_km_h]
    interval = physics.sample_interval_s
    simulator = Simulator(truth, physics, profile, int(np.ceil(max(length) / interval)))
    made = []
    for case in truth.load_cases:
        for speed, seconds in zip(physics.speeds_km_h, length, strict=True):
            for repeat in range(1, physics.repeats + 1):
                file = f"bump_runs/{case}_{speed:g}kmh_run{repeat}.csv"
                true_speed = speed / 3.6 * (1.0 + physics.speed_spread * rng.normal())
                run = Made(file, case, speed, repeat, true_speed, rng.uniform(*physics.start_s))
                clean = simulator.readings(case, run.speed_m_s, run.start_s)[: int(seconds / interval)]
                columns, kinds = sensor_columns(len(truth.vehicle.axles))
                write_log(folder / file, interval, columns, kinds, measured(clean, kinds, physics, rng))
                made.append(run)
    return made


def _write_drops(folder: Path, physics: Physics, truth: TrueVehicle, rng) -> list[Made]:
    case, interval = next(iter(truth.load_cases)), physics.sample_interval_s
    edge = PLANK_RAMP_M + PLANK_TOP_M + 0.3
    profile = plank_profile(physics)
    seconds = 1.0 + edge / PLANK_SPEEDS_M_S[0] + DROP_AFTER_S + 0.5
    simulator = Simulator(truth, physics, profile, int(np.ceil(seconds / interval)))
    count = len(truth.vehicle.axles)
    made = []
    for i, axle in enumerate(truth.vehicle.axles):
        for repeat in range(1, physics.drops_per_axle + 1):
            speed = rng.uniform(*PLANK_SPEEDS_M_S)
            # The named axle is at the start of the ramp one second after the simulation starts.
            start = 1.0 - axle.x_m / speed
            clean = simulator.readings(case, speed, start, only_axle=i)[:, i::count]
            off = 1.0 + (edge - profile.start_m) / speed
            first = round((off - DROP_BEFORE_S - rng.uniform(0.0, 0.4)) / interval)
            part = clean[first : first + round((DROP_BEFORE_S + DROP_AFTER_S) / interval)]
            file = f"plank_drops/axle{i + 1}_drop{repeat}.csv"
            columns, kinds = ["frame_axle_mm", "axle_accel_g", "frame_accel_g"], ["lvdt", "axle", "frame"]
            write_log(folder / file, interval, columns, kinds, measured(part - part[0], kinds, physics, rng))
            made.append(Made(file, axle.name, 0.0, repeat, speed, off - first * interval))
    return made


def main(arguments: list[str] | None = None) -> None:
    """Command line: every field of `Physics` is an option."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, required=True)
    for f in fields(Physics):
        name = f"--{f.name.replace('_', '-')}"
        default = f.default
        if isinstance(default, tuple):
            parser.add_argument(name, type=float, nargs="+", default=list(default))
        else:
            parser.add_argument(
                name, type=type(default), default=default, choices=NAMES if f.name == "vehicle" else None
            )
    options = vars(parser.parse_args(arguments))
    folder = options.pop("output")
    physics = Physics(**{k: tuple(v) if isinstance(v, list) else v for k, v in options.items()})
    jax.config.update("jax_enable_x64", True)
    write_campaign(folder, physics)


if __name__ == "__main__":
    main()
