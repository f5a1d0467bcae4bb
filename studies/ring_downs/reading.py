"""One replicate: what the drop analysis says of a simulated ring-down, beside the truth."""

from __future__ import annotations

import math

import numpy as np

from studies.coverage.shards import Record as Replicate
from studies.ring_downs.motion import INTERVAL_S, Record, draw
from sysid.campaign.records import Channel, Log, PlankDrop, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.sdof.analysis import analyse_drop
from sysid.sdof.drop_results import DropAnalysis
from sysid.sdof.settings import DropSettings

SEED = 2026
#: The study asks for the error of the reading: the masses and the tire, which here is rigid, are known.
EXACT = DropSettings(
    tire_stiffness_tolerance=0.0,
    tire_damping_tolerance=0.0,
    unsprung_mass_tolerance=0.0,
    tributary_mass_tolerance=0.0,
)
_UNSPRUNG_KG, _RIGID = 1.0, 1e12
_SENSOR = Sensor("frame_axle_mm", "suspension_deflection", "mm", axle=0)


def analysed(record: Record) -> DropAnalysis:
    """The drop analysis of a body that was let go on one axle."""
    axle = Axle("only", 0, 0.0, _UNSPRUNG_KG, _RIGID, 0.0, 0.5, "leaf")
    mass = record.oscillator.mass
    case = LoadCase("empty", (mass + _UNSPRUNG_KG,), (mass,), (1000.0,), (1.0,))
    channel = Channel(_SENSOR, record.time_s, record.value_m, np.zeros(record.time_s.size, np.int8))
    drop = PlankDrop(0, "empty", None, Log("drop.csv", INTERVAL_S, (channel,)), release="body", lifted=(0,))
    return analyse_drop(drop, Vehicle("one axle", (Body("body"),), (axle,)), case, EXACT)


def replicate(number: int, seed: int = SEED) -> Replicate:
    """Kind, period, k, c, F and Q of one ring-down with their standard deviations, and the truth."""
    record = draw(seed, number)
    found = analysed(record)
    estimate = next(e for e in found.estimates if e.method == "free_decay")
    o = record.oscillator
    period_sd = estimate_period_sd(found)
    quantities = {
        "period": (o.damped_period, estimate.damped_period, period_sd),
        "k": (o.stiffness, estimate.stiffness, estimate.stiffness_sd),
        "c": (o.damping, estimate.damping, estimate.damping_sd),
        "F": (o.friction, estimate.friction_force, estimate.friction_force_sd),
        "Q": (o.quadratic, estimate.quadratic_damping, estimate.quadratic_damping_sd),
    }
    return {
        "number": number,
        "kind": " + ".join(record.kind),
        "found": found.damping_kind,
        "usable": bool(estimate.usable),
        "visible": record.visible,
        "clear": record.clear,
        "shares": record.shares,
        "quantities": {n: [v if math.isfinite(v) else None for v in map(float, q)] for n, q in quantities.items()},
    }


def estimate_period_sd(found: DropAnalysis) -> float:
    """Standard deviation of the period of method free_decay [s], from that of the stiffness: k goes with its square.

    The stiffness also depends on the decrement, little where the damping is light.
    """
    if found.law is not None:
        return float(np.sqrt(found.law.covariance[0, 0]))
    estimate = next(e for e in found.estimates if e.method == "free_decay")
    return 0.5 * estimate.damped_period * estimate.stiffness_sd / estimate.stiffness
