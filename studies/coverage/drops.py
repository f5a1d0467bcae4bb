"""Plank drops of one axle on its tire: ranks of the true k and c among draws of the drop analysis.

The truck is the quarter car that the analysis assumes, solved exactly (matrix exponential, input linear between
samples), with tributary mass, unsprung mass and tire off by their declared tolerances.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lsim

from studies.coverage.shards import Record
from sysid.campaign.records import Channel, Log, PlankDrop, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.sdof.analysis import analyse_drop
from sysid.sdof.settings import DropSettings

#: Prior of the suspension: median and log standard deviation of k [N/m] and c [N s/m].
STIFFNESS, DAMPING = (4.2e5, 0.25), (1.0e4, 0.3)
METHODS = ("corrected", "free_decay")
NOISE_M, PLANK_M, INTERVAL_S, SECONDS, FALL_S = 2.5e-4, 0.075, 0.005, 4.5, 0.06
DRAWS = 99
_FINE = 10
_SEED = 21
_AXLES = (
    Axle("front", 0, 0.0, 540.0, 1.65e6, 3000.0, 0.5, "leaf"),
    Axle("rear", 0, 4.7, 1050.0, 2.9e6, 3000.0, 0.5, "air"),
)
VEHICLE = Vehicle("two axles", (Body("truck"),), _AXLES)
CASE = LoadCase("empty", (3955.0, 4000.0), (6365.0,), (20000.0,), (1.1,))
SENSOR = Sensor("frame_axle_mm", "suspension_deflection", "mm", axle=0)


def deflection(
    stiffness: float, damping: float, mass: float, unsprung: float, tire: float, tire_damping: float, release_s: float
) -> np.ndarray:
    """Frame-axle distance (T,) [m] of a quarter car whose road falls by the plank's height at `release_s`."""
    k, c, kt, ct = stiffness, damping, tire, tire_damping
    body = np.array([-k, -c, k, c]) / mass
    axle = np.array([k, c, -k - kt, -c - ct]) / unsprung
    system = np.array([[0.0, 1.0, 0.0, 0.0], body, [0.0, 0.0, 0.0, 1.0], axle])
    force = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [kt / unsprung, ct / unsprung]])
    time = np.arange(round(SECONDS / INTERVAL_S) * _FINE) * INTERVAL_S / _FINE
    s = np.clip((time - release_s) / FALL_S, 0.0, 1.0)
    road = PLANK_M * (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
    rate = -PLANK_M * 30.0 * s**2 * (1.0 - s) ** 2 / FALL_S
    out = np.array([[1.0, 0.0, -1.0, 0.0]])
    rest = np.array([PLANK_M, 0.0, PLANK_M, 0.0])
    _, y, _ = lsim((system, force, out, np.zeros((1, 2))), np.stack([road, rate], axis=1), time, rest)
    return np.asarray(y).ravel()[::_FINE]


def replicate(number: int) -> Record:
    """One drop: estimates in log space and the ranks of the truth among draws of their normal."""
    random = np.random.default_rng([_SEED, number])
    settings = DropSettings()
    k, c = (m * np.exp(s * random.standard_normal()) for m, s in (STIFFNESS, DAMPING))
    axle = _AXLES[0]
    declared = np.array(
        [
            CASE.axle_loads_kg[0] - axle.unsprung_mass_kg,
            axle.unsprung_mass_kg,
            axle.tire_stiffness_N_per_m,
            axle.tire_damping_N_s_per_m,
        ]
    )
    tolerance = np.array(
        [
            settings.tributary_mass_tolerance,
            settings.unsprung_mass_tolerance,
            settings.tire_stiffness_tolerance,
            settings.tire_damping_tolerance,
        ]
    )
    true = declared * np.exp(tolerance * random.standard_normal(4))
    mass, unsprung, tire, tire_damping = (float(v) for v in true)
    clean = deflection(k, c, mass, unsprung, tire, tire_damping, release_s=0.8 + random.uniform(0.0, 0.3))
    value = clean + NOISE_M * (random.standard_normal(clean.size) + random.uniform(-6.0, 6.0))
    time = np.arange(value.size) * INTERVAL_S
    channel = Channel(SENSOR, time, value, np.zeros(value.size, np.int8))
    drop = PlankDrop(0, "empty", PLANK_M, Log("drop.csv", INTERVAL_S, (channel,)))
    found = analyse_drop(drop, VEHICLE, CASE, settings)
    entries = []
    for e in found.estimates:
        if e.method not in METHODS or not e.usable:
            continue
        for name, truth, value_, sd in (
            (f"k {e.method}", k, e.stiffness, e.stiffness_sd),
            (f"c {e.method}", c, e.damping, e.damping_sd),
        ):
            spread = sd / value_
            draws = np.log(value_) + spread * random.standard_normal(DRAWS)
            z = float((np.log(truth) - np.log(value_)) / spread)
            entries.append({"name": name, "rank": int((draws < np.log(truth)).sum()), "z": z, "sd": float(spread)})
    return {"number": number, "entries": entries}
