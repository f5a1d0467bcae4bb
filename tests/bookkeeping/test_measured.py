"""What logs say of declared numbers: readings are written by hand, so that every value is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sysid.bookkeeping.elimination import sentences
from sysid.bookkeeping.measured import measured_values
from sysid.campaign.records import BumpRun, Campaign, Channel, Log, PlankDrop, Sensor
from sysid.campaign.vehicle_records import Vehicle
from tests.bookkeeping.test_usual import FRONT, REAR, TRAILER, VEHICLE, campaign

TIME = 0.005 * np.arange(800)


def log(name: str, deflection: np.ndarray) -> Log:
    sensor = Sensor("q", "suspension_deflection", "m", axle=0)
    return Log(name, 0.005, (Channel(sensor, TIME, deflection, np.zeros(800, np.int8)),))


def run(jounce_m: float, rebound_m: float) -> BumpRun:
    """A compression and an extension after a second at rest, with an offset of the sensor."""
    motion = np.where(TIME > 1.0, -jounce_m * np.sin(2.0 * np.pi * (TIME - 1.0)), 0.0)
    return BumpRun(
        "case", "empty", 4.0, 1, log("run.csv", 0.3 + np.where(motion > 0.0, motion * rebound_m / jounce_m, motion))
    )


def drop(name: str, height_m: float, compressed_m: float) -> PlankDrop:
    return PlankDrop(0, "empty", height_m, log(name, np.where(TIME < 1.0, -compressed_m, 0.0)))


def with_front(**changes: object) -> Vehicle:
    return replace(VEHICLE, axles=(replace(FRONT, **changes), REAR, TRAILER))  # type: ignore[arg-type]


def said(of: Campaign, hop_hz: dict[int, float] | None = None) -> list[str]:
    return sentences(measured_values(of, hop_hz or {}, []))


def test_tires_follow_from_wheel_hop() -> None:
    # (2 pi 10)^2 600 = 2.369 MN/m, 1.316 times the declared 1.8 MN/m: tires and suspension.
    (value,) = [v for v in measured_values(campaign(), {0: 10.0}, []) if "hop" in v.what]
    assert value.value == pytest.approx((2.0 * math.pi * 10.0) ** 2 * 600.0 / 1.8e6)
    assert said(campaign(), {0: 10.0}) == []
    (sentence,) = said(campaign(with_front(tire_stiffness_N_per_m=0.45e6)), {0: 10.0})
    assert "tire_stiffness_N_per_m of 'front' (450000)" in sentence


def test_a_factor_of_two_on_tires_needs_more_than_one_axle() -> None:
    """The hop of one axle, which moves with the frame, is no witness for so little; that of all axles is."""
    assert said(campaign(with_front(tire_stiffness_N_per_m=0.9e6)), {0: 10.0}) == []
    hop_hz = {
        i: math.sqrt(1.3 * axle.tire_stiffness_N_per_m / mass) / (2.0 * math.pi)
        for i, (axle, mass) in enumerate(zip(VEHICLE.axles, VEHICLE.unsprung_mass_kg, strict=True))
    }
    assert said(campaign(VEHICLE), hop_hz) == []
    assert said(campaign(with_front(tire_stiffness_N_per_m=0.9e6)), hop_hz) == []
    halves = tuple(replace(a, tire_stiffness_N_per_m=0.5 * a.tire_stiffness_N_per_m) for a in VEHICLE.axles)
    (sentence,) = said(campaign(replace(VEHICLE, axles=halves)), hop_hz)
    assert "all tire_stiffness_N_per_m" in sentence
    assert "as if given of one side" in sentence


@pytest.mark.parametrize(
    ("key", "travel_m"), [("jounce_travel_m", 0.008), ("jounce_travel_m", 0.03), ("rebound_travel_m", 0.09 / 25.4)]
)
def test_travels_that_the_logs_exceed_are_named(key: str, travel_m: float) -> None:
    # 60 mm and 40 mm of free 80 mm and 90 mm.
    assert said(campaign(bump_runs=(run(0.06, 0.04),))) == []
    (sentence,) = said(campaign(with_front(**{key: travel_m}), bump_runs=(run(0.06, 0.04),)))
    assert sentence.startswith(f"{key} of 'front' ({travel_m:g})")


def test_a_plank_of_another_height_compresses_another_length() -> None:
    right = (drop("a.csv", 0.075, 0.03), drop("b.csv", 0.15, 0.06), drop("c.csv", 0.075, 0.031))
    assert said(campaign(plank_drops=right)) == []
    # The same compression on a plank that is listed as twice as high.
    sentence = " ".join(said(campaign(plank_drops=(right[0], drop("b.csv", 0.15, 0.03)))))
    assert "plank_height_m of the drop a.csv (0.075)" in sentence
    assert "plank_height_m of the drop b.csv (0.15)" in sentence
    # A third drop tells which of the two it is.
    (sentence,) = said(campaign(plank_drops=(right[0], drop("b.csv", 0.15, 0.03), right[2])))
    assert sentence.startswith("plank_height_m of the drop b.csv (0.15), as if given twice")
