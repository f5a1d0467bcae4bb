"""One replicate: what the drop analysis says of a made plank drop, beside the truth."""

from __future__ import annotations

import math
import time

import numpy as np

from studies.coverage.shards import Record as Replicate
from studies.plank_drops.motion import INTERVAL_S, PLANK_M, Record, draw
from sysid.campaign.records import Channel, Log, PlankDrop, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.sdof.analysis import analyse_drop
from sysid.sdof.drop_results import DropAnalysis
from sysid.threads import one_blas_thread

SEED = 4906
_SENSOR = Sensor("frame_axle_mm", "suspension_deflection", "mm", axle=0)


def analysed(record: Record) -> DropAnalysis:
    """The drop analysis of a vehicle of one axle, with the declared masses and tire."""
    mass, unsprung, tire, tire_damping = (float(v) for v in record.declared)
    axle = Axle("only", 0, 0.0, unsprung, tire, tire_damping, 0.5, "leaf")
    case = LoadCase("empty", (mass + unsprung,), (mass,), (1000.0,), (1.0,))
    channel = Channel(_SENSOR, record.time_s, record.value_m, np.zeros(record.time_s.size, np.int8))
    drop = PlankDrop(0, "empty", PLANK_M, Log("drop.csv", INTERVAL_S, (channel,)))
    return analyse_drop(drop, Vehicle("one axle", (Body("body"),), (axle,)), case)


def replicate(number: int, seed: int = SEED) -> Replicate:
    """Kind, and k and c of every method with their standard deviations beside the truth."""
    record = draw(seed, number)
    begin = time.process_time()
    # As in the program: with more threads, small matrices wait for each other.
    with one_blas_thread():
        found = analysed(record)
    took = time.process_time() - begin
    rows = {}
    for e in found.estimates:
        numbers = (e.stiffness, e.stiffness_sd, e.damping, e.damping_sd)
        rows[e.method] = {
            "usable": bool(e.usable),
            "numbers": [float(v) if math.isfinite(v) else None for v in numbers],
            "note": e.note,
        }
    return {
        "number": number,
        "kind": record.kind,
        "found": found.damping_kind,
        "truth": [record.car.stiffness, record.car.damping],
        "friction_share": record.car.friction / (record.car.mass * 9.81),
        "beat_share": record.car.beat_share,
        "rows": rows,
        "seconds": took,
    }
