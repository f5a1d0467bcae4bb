"""Mistakes made on purpose in the linear truck are named, and nothing is said of the truck as it is.

What is wrong is known because the test made it so; magnitudes in the sentences are compared with what was changed.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from split_cases import first_then_long

from sysid.bookkeeping import check, check_bookkeeping, wheels
from sysid.bookkeeping.wheels import hop_frequency
from sysid.campaign import read_campaign
from sysid.campaign.passage.arrivals import Arrival, Passage
from sysid.campaign.quality import suspects
from sysid.campaign.quality.check import check_quality
from sysid.campaign.records import BumpRun, Campaign, Channel, Log, Scan, Sensor
from sysid.road.effective import effective_profiles
from sysid.road.point_cloud import read_point_cloud
from sysid.road.road_profile import RoadProfile
from sysid.road.scan import ScanAnalysis, analyse_scan

ROOT = Path(__file__).parents[2]


@lru_cache(maxsize=2)
def truck(name: str = "examples/linear_truck") -> Campaign:
    return read_campaign(ROOT / name, point_cloud_reader=read_point_cloud)


@lru_cache(maxsize=4)
def analysed(scan: Scan) -> ScanAnalysis:
    return analyse_scan(scan)


@pytest.fixture(autouse=True)
def scans_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most mistakes leave the scan as it is: it is analysed once, which is a third of the time of a check."""
    monkeypatch.setattr(Scan, "__hash__", object.__hash__)
    monkeypatch.setattr(Scan, "__eq__", object.__eq__)
    monkeypatch.setattr(check, "analyse_scan", analysed)


def said(campaign: Campaign) -> str:
    screened, report = check_quality(campaign)
    return "\n".join((*report.messages, *check_bookkeeping(screened, campaign).messages))


def with_channel(campaign: Campaign, column: str, change) -> Campaign:
    def changed(channel: Channel) -> Channel:
        return replace(channel, value=change(channel.value)) if channel.sensor.column == column else channel

    runs = [replace(r, log=replace(r.log, channels=tuple(map(changed, r.log.channels)))) for r in campaign.bump_runs]
    return replace(campaign, bump_runs=tuple(runs))


def with_axles(campaign: Campaign, change) -> Campaign:
    """Axles changed one by one; hinges and frame sensors stay."""
    axles = tuple(change(i, a) for i, a in enumerate(campaign.vehicle.axles))
    return replace(campaign, vehicle=replace(campaign.vehicle, axles=axles))


def with_cases(campaign: Campaign, change) -> Campaign:
    return replace(campaign, load_cases={name: change(case) for name, case in campaign.load_cases.items()})


@pytest.mark.parametrize("name", ["examples/linear_truck", "data"])
def test_healthy_trucks_are_not_accused(name: str) -> None:
    campaign = truck(name)
    screened, _ = check_quality(campaign)
    found = check_bookkeeping(screened, campaign)
    assert found.contradictions == ()
    assert found.left_out == ()
    # Runs at 32 and 16 km/h at most, predictions at 48 and 24 km/h.
    beyond = [f"{case}, {v} km/h: faster than any run" for case, v in (("unloaded", 48), ("loaded", 24))]
    assert [m.partition(" of this")[0] for m in found.messages] == beyond
    assert all("speed_km_h is 1.5 times" in m for m in found.messages)
    # Listed speeds are within 2.5 % of the true ones.
    for run in found.speeds:
        assert run.measured_m_s == pytest.approx(run.listed_m_s, rel=0.03)
    (scan,) = found.scans
    # What truth.toml says of both bumps.
    assert scan.height_m == pytest.approx(0.079, abs=0.0015)
    assert np.degrees(scan.heading_rad) == pytest.approx(np.degrees(scan.declared_heading_rad), abs=0.3)


def test_positions_that_are_too_small_are_named_with_their_factor() -> None:
    small = with_axles(truck(), lambda i, a: replace(a, x_m=0.93 * a.x_m))
    (factor,) = re.findall(r"multiply all x_m by (\d+\.\d+)", said(small))
    assert float(factor) == pytest.approx(1 / 0.93, abs=0.02)


def test_one_axle_off_is_named_with_its_place() -> None:
    moved = with_axles(truck(), lambda i, a: replace(a, x_m=a.x_m + 0.3 * (i == 3)))
    text = said(moved)
    assert "'first trailer' at 13.3" in text
    assert "instead of 13.63" in text


def test_two_passes_in_one_log_are_named() -> None:
    def twice(channel: Channel) -> Channel:
        length = channel.time_s[-1] + 0.005
        time = np.concatenate([channel.time_s, channel.time_s + length])
        return replace(channel, time_s=time, value=np.tile(channel.value, 2), censored=np.tile(channel.censored, 2))

    runs = list(truck().bump_runs)
    whole = runs[3].log
    runs[3] = replace(runs[3], log=replace(whole, channels=tuple(map(twice, whole.channels))))
    text = said(replace(truck(), bump_runs=tuple(runs)))
    (found,) = re.findall(rf"{whole.file}: \d axles shake again from (\d+\.\d) s on", text)
    # The first axle meets the bump as long after the joint as after the begin of the log.
    begin = next(c for c in whole.channels if c.sensor.kind == "axle_acceleration" and c.sensor.axle == 0)
    size = np.abs(begin.value - np.median(begin.value))
    first = begin.time_s[size > 0.3 * size.max()][0]
    assert float(found) == pytest.approx(begin.time_s[-1] + first, abs=0.3)
    assert text.count("shake again") == 1


def test_a_log_of_a_truck_that_stands_is_named() -> None:
    # The quiet second before the bump, again and again.
    def standing(channel: Channel) -> Channel:
        return replace(channel, value=np.resize(channel.value[channel.time_s < 0.8], channel.value.size))

    runs = list(truck().bump_runs)
    runs[3] = replace(runs[3], log=replace(runs[3].log, channels=tuple(map(standing, runs[3].log.channels))))
    text = said(replace(truck(), bump_runs=tuple(runs)))
    assert f"{runs[3].log.file}: the axles hardly move" in text
    assert text.count("the axles hardly move") == 1


def test_axles_from_the_rear_are_named() -> None:
    turned = with_axles(truck(), lambda i, a: replace(a, x_m=-a.x_m))
    assert "listed from the rear" in said(turned)


def test_load_cases_exchanged_are_named() -> None:
    other = {"unloaded": "loaded", "loaded": "unloaded"}
    runs = tuple(replace(r, load_case=other[r.load_case]) for r in truck().bump_runs)
    assert "load cases of the bump runs seem exchanged" in said(replace(truck(), bump_runs=runs))


def test_one_run_of_another_load_case_is_named() -> None:
    runs = list(truck().bump_runs)
    runs[2] = replace(runs[2], load_case="loaded")
    text = said(replace(truck(), bump_runs=tuple(runs)))
    assert f"{runs[2].log.file}: the frames move as with the masses of the load case 'unloaded'" in text
    assert text.count("the frames move as") == 1


def test_axle_loads_from_the_rear_are_no_other_load_case() -> None:
    def turned(case):
        return replace(case, axle_loads_kg=case.axle_loads_kg[::-1])

    text = said(with_cases(truck(), turned))
    assert "axle_loads_kg in the opposite order" in text
    assert "load cases of the bump runs seem exchanged" not in text
    assert "exchanging the loads" not in text


def test_readings_of_one_side_are_named() -> None:
    under = [sum(a.unsprung_mass_kg for a in truck().vehicle.axles if a.body == b) for b in range(2)]

    def of_one_side(case):
        # As a person fills it in: half of every reading, and that less the unsprung masses.
        sprung = tuple(0.5 * (m + u) - u for m, u in zip(case.sprung_mass_kg, under, strict=True))
        return replace(case, axle_loads_kg=tuple(0.5 * m for m in case.axle_loads_kg), sprung_mass_kg=sprung)

    text = said(with_cases(truck(), of_one_side))
    assert "twice the axle_loads_kg" in text
    assert "the centre of gravity is" not in text


def test_a_load_case_with_the_readings_of_another_is_named() -> None:
    empty, laden = truck().load_cases
    copied = replace(
        truck().load_cases[laden],
        axle_loads_kg=truck().load_cases[empty].axle_loads_kg,
        sprung_mass_kg=truck().load_cases[empty].sprung_mass_kg,
    )
    text = said(replace(truck(), load_cases={**truck().load_cases, laden: copied}))
    assert f"'{empty}' and '{laden}' have the same axle_loads_kg" in text
    assert "the centre of gravity is" not in text


@pytest.mark.parametrize("factor", [1e-3, 10.0])
def test_inertia_in_another_unit_is_named(factor: float) -> None:
    def wrong(case):
        return replace(case, pitch_inertia_kg_m2=tuple(factor * j for j in case.pitch_inertia_kg_m2))

    assert "pitch_inertia_kg_m2" in said(with_cases(truck(), wrong))


def test_a_wrong_inertia_is_no_other_load_case() -> None:
    # With the masses of the other one, an axle of the shipped truck would push the wrong way.
    def tons(case):
        return replace(case, pitch_inertia_kg_m2=tuple(1e-3 * j for j in case.pitch_inertia_kg_m2))

    text = said(with_cases(truck("data"), tons))
    assert "pitch_inertia_kg_m2" in text
    assert "move as with the masses" not in text


def test_a_run_that_lost_a_deflection_is_judged_too() -> None:
    campaign = truck("data")
    (number,) = [k for k, r in enumerate(campaign.bump_runs) if r.log.file.endswith("unloaded_24kmh_run2.csv")]
    runs = list(campaign.bump_runs)
    runs[number] = replace(runs[number], load_case="loaded")
    text = said(replace(campaign, bump_runs=tuple(runs)))
    assert f"{runs[number].log.file}: the frames move as with the masses of the load case 'unloaded'" in text


@pytest.mark.parametrize("share", [1.0, 0.0])
def test_wheels_at_rest_behind_the_bump_tell_no_frequency(share: float) -> None:
    """Where nothing but noise is left, it is no hop: the first second of rest in place of what follows the bump."""
    campaign = truck()
    runs = []
    for run in campaign.bump_runs:
        channels = []
        for c in run.log.channels:
            if c.sensor.kind != "axle_acceleration":
                channels.append(c)
                continue
            rest = np.random.default_rng(4).normal(0.0, 0.25, c.value.size)
            late = c.time_s > 0.4 * c.time_s[-1]
            channels.append(replace(c, value=np.where(late, share * c.value + (1.0 - share) * rest, c.value)))
        runs.append(replace(run, log=replace(run.log, channels=tuple(channels))))
    assert "hop at" not in said(replace(campaign, bump_runs=tuple(runs)))


def test_the_runs_that_shake_a_wheel_tell_its_frequency() -> None:
    """After three slow runs the axle moves with the frame at 6 Hz, a little; after the fast one it hops at 10 Hz."""
    time = 0.005 * np.arange(800)
    after = np.clip(time - 1.5, 0.0, None)
    runs, passages = [], {}
    for number, (speed, size, frequency) in enumerate([(7.0, 30.0, 10.0), *3 * [(2.0, 2.0, 6.0)]]):
        ring = size * np.exp(-2.0 * after) * np.sin(2.0 * np.pi * frequency * after)
        noise = np.random.default_rng(number).normal(0.0, 0.05, time.size)
        channel = Channel(Sensor("a", "axle_acceleration", "g", axle=0), time, ring + noise, np.zeros(800, np.int8))
        runs.append(BumpRun("case", "empty", speed, 1, Log(f"run{number}.csv", 0.005, (channel,))))
        passages[f"run{number}.csv"] = Passage(speed, {0: Arrival(1.5, 1, 0.5)}, 1)
    assert hop_frequency(runs, passages, 0) == pytest.approx(10.0, abs=0.3)


@pytest.mark.parametrize(
    ("frequency", "decay", "found"), [(5.6, 25.0, False), (5.6, 8.0, False), (6.5, 4.0, True), (9.0, 25.0, True)]
)
def test_a_shoulder_of_the_motion_of_the_frame_is_no_hop(frequency: float, decay: float, found: bool) -> None:
    """What has its highest point at 5.6 Hz is as large at 5 Hz; a hop stands alone, or is faster than frames move."""
    time = 0.005 * np.arange(800)
    after = np.clip(time - 1.9, 0.0, None)
    ring = 30.0 * np.exp(-decay * after) * np.sin(2.0 * np.pi * frequency * after)
    value = ring + np.random.default_rng(3).normal(0.0, 0.02, time.size)
    channel = Channel(Sensor("a", "axle_acceleration", "g", axle=0), time, value, np.zeros(800, np.int8))
    run = BumpRun("case", "empty", 4.0, 1, Log("run.csv", 0.005, (channel,)))
    hz = hop_frequency([run], {"run.csv": Passage(4.0, {0: Arrival(1.5, 1, 0.5)}, 1)}, 0)
    assert (hz is not None) == found
    assert not found or hz == pytest.approx(frequency, abs=0.3)


def test_all_masses_in_pounds_show_in_the_hop_of_the_wheels() -> None:
    def pounds(case):
        names = ("axle_loads_kg", "sprung_mass_kg", "pitch_inertia_kg_m2")
        return replace(case, **{n: tuple(2.20462 * v for v in getattr(case, n)) for n in names})

    heavy = with_axles(
        with_cases(truck(), pounds), lambda i, a: replace(a, unsprung_mass_kg=2.20462 * a.unsprung_mass_kg)
    )
    text = said(heavy)
    assert "all masses (axle_loads_kg, sprung_mass_kg, unsprung_mass_kg), as if given in lb" in text
    assert "hop at" in text


@pytest.mark.parametrize("factor", first_then_long(0.5, 0.25, 1e-3))
def test_stiffness_of_one_tire_is_named(factor: float) -> None:
    soft = with_axles(truck(), lambda i, a: replace(a, tire_stiffness_N_per_m=factor * a.tire_stiffness_N_per_m))
    assert "tire_stiffness_N_per_m" in said(soft)


def test_a_diameter_for_the_radius_is_named() -> None:
    # 315/80 R 22.5: 22.5 inches and twice 0.8 of 315 mm.
    diameter = 22.5 * 0.0254 + 2.0 * 0.8 * 0.315
    for radius, wrong in ((0.5 * diameter, False), (diameter, True)):
        large = with_axles(truck(), lambda i, a, radius=radius: replace(a, tire_radius_m=radius))
        assert ("all tire_radius_m (1.0755, " in said(large)) == wrong


def test_tires_that_are_too_soft_for_their_pressure_are_named_with_it() -> None:
    # 120 psi for 827 kPa, at which the stiffness was measured: tires a sixth as stiff.
    def in_psi(i, axle):
        softer = axle.tire_stiffness_N_per_m / 6.0
        return replace(
            axle, tire_stiffness_N_per_m=softer, inflation_pressure_Pa=120e3, tire_stiffness_pressure_Pa=827e3
        )

    assert "all inflation_pressure_kPa (120, 120, 120, 120, 120 and 120), as if given in psi" in said(
        with_axles(truck(), in_psi)
    )


@pytest.mark.parametrize("factor", first_then_long(0.9, 1.1, 1.2))
@pytest.mark.parametrize("column", ["lvdt4_mm", "frame4_accel_g", "axle4_accel_g"])
def test_a_gain_is_named_with_its_size(column: str, factor: float) -> None:
    text = said(with_channel(truck(), column, lambda y: factor * y))
    (gain,) = re.findall(rf"'{column}' reads (\S+) times", text)
    assert float(gain) == pytest.approx(factor, abs=0.03)
    assert text.count(" times what ") == 1


@pytest.mark.parametrize("samples", first_then_long(1, 4, 20))
@pytest.mark.parametrize("column", ["lvdt2_mm", "frame2_accel_g", "axle2_accel_g"])
def test_a_lag_is_named_with_its_size(column: str, samples: int) -> None:
    def late(y: np.ndarray) -> np.ndarray:
        return np.concatenate([np.full(samples, y[0]), y[:-samples]])

    text = said(with_channel(truck(), column, late))
    (lag,) = re.findall(rf"'{column}' is (\d+) ms late", text)
    assert float(lag) == pytest.approx(5 * samples, abs=1)


def _axle_late(campaign: Campaign, axle: int, samples: int) -> Campaign:
    for column in (f"lvdt{axle}_mm", f"axle{axle}_accel_g", f"frame{axle}_accel_g"):
        campaign = with_channel(campaign, column, lambda y: np.concatenate([np.full(samples, y[0]), y[:-samples]]))
    return campaign


def test_a_box_that_lags_behind_is_named_with_its_time() -> None:
    text = said(_axle_late(truck(), 4, 20))
    (late,) = re.findall(r"axle 'first trailer' show the bump (\d+) ms too late", text)
    assert float(late) == pytest.approx(100.0, abs=20.0)


def test_a_box_so_late_that_its_axle_is_lost_is_named() -> None:
    text = said(_axle_late(truck(), 4, 60))
    (late,) = re.findall(r"All sensors of the axle 'first trailer' show the bump (\d+) ms too late", text)
    assert float(late) == pytest.approx(300.0, abs=15.0)


def test_a_deflection_without_its_low_frequencies_is_named() -> None:
    sos = butter(1, 1.0, "highpass", fs=200.0, output="sos")
    text = said(with_channel(truck(), "lvdt2_mm", lambda y: sosfilt(sos, np.nan_to_num(y) - np.median(y[:40]))))
    assert "'lvdt2_mm' lacks what is slower than about 1 Hz" in text


def test_unsprung_masses_exchanged_are_named() -> None:
    masses = [a.unsprung_mass_kg for a in truck().vehicle.axles]
    swapped = with_axles(truck(), lambda i, a: replace(a, unsprung_mass_kg=masses[{0: 1, 1: 0}.get(i, i)]))
    assert "'front steer' and 'forward tandem drive' hop as if each axle had the unsprung_mass_kg of the other" in said(
        swapped
    )


def test_noise_before_the_bump_turns_no_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    # At walking speed the way in which an axle begins to move is lost in noise; here all seem to fall.
    monkeypatch.setattr(suspects, "_lift", lambda *_: -1.0)
    assert "all signs are flipped" not in said(truck())
    turned = truck()
    for column in {c.sensor.column for run in truck().bump_runs for c in run.log.channels}:
        turned = with_channel(turned, column, np.negative)
    assert "all signs are flipped" in said(turned)


def test_crosstalk_is_named_with_its_source() -> None:
    campaign = truck()

    def leaking(run):
        known = {c.sensor.column: c.value for c in run.log.channels}
        channels = tuple(
            replace(c, value=c.value + 0.25 * known["frame1_accel_g"]) if c.sensor.column == "frame5_accel_g" else c
            for c in run.log.channels
        )
        return replace(run, log=replace(run.log, channels=channels))

    text = said(replace(campaign, bump_runs=tuple(map(leaking, campaign.bump_runs))))
    (share,) = re.findall(r"'frame5_accel_g' contains about (\d+) % of 'frame1_accel_g'", text)
    assert float(share) == pytest.approx(25, abs=3)


def test_a_frame_sensor_at_another_place_is_named() -> None:
    def moved(channel: Channel) -> Channel:
        s = channel.sensor
        return replace(channel, sensor=replace(s, x_m=s.x_m + 1.5)) if s.column == "frame5_accel_g" else channel

    runs = tuple(replace(r, log=replace(r.log, channels=tuple(map(moved, r.log.channels)))) for r in truck().bump_runs)
    (place,) = re.findall(
        r"'frame5_accel_g' moves as the frame does at x_m = (\S+) m", said(replace(truck(), bump_runs=runs))
    )
    assert float(place) == pytest.approx(14.63, abs=0.3)


def quasi_static_rise(station_m: np.ndarray, height_m: float, length_m: float) -> np.ndarray:
    """Rise of a wheel of 0.5 m, sunk 20 mm, over a plank at constant load: unit spokes on a grid of heights."""
    phi, rho = np.linspace(-0.9, 0.9, 161)[:, None], np.linspace(0.4, 0.5, 101)
    sunk = np.arange(-0.044, 0.021, 0.004)

    def force(station: float, rise: float) -> float:
        under, below = station + rho * np.sin(phi), 0.48 + rise - rho * np.cos(phi)
        inside = below <= np.where((under > 0.0) & (under < length_m), height_m, 0.0)
        met = np.where(inside.any(axis=1), rho[inside.argmax(axis=1)], 0.5)
        return float(np.trapezoid((0.5 - met) ** 0.7 * np.cos(phi[:, 0]), phi[:, 0]))

    level = force(-5.0, 0.0)
    return np.array([np.interp(-level, [-force(s, -u) for u in sunk[::-1]], -sunk[::-1]) for s in station_m])


def test_a_plank_is_as_high_as_it_is_for_wheels_that_bridge_its_edges() -> None:
    """A wheel that rises as a fan of spokes does over 40 mm x 150 mm, slowly."""
    along = np.arange(0.0, 0.751, 0.002)
    plank = RoadProfile("bump", along, np.where((along > 0.3) & (along < 0.45), 0.04, 0.0), 0.0 * along, 0.302, 0.146)
    stations = np.arange(-0.3, 0.46, 0.02)
    rise = quasi_static_rise(stations, 0.04, 0.15)
    assert 0.015 < rise.max() < 0.038
    run = truck().bump_runs[0]
    time = np.arange(0.0, 4.0, 0.005)
    path = np.interp(1.5 * (time - 2.0), stations, rise, left=0.0, right=0.0)
    values = {"axle_acceleration": np.gradient(np.gradient(path, 0.005), 0.005), "suspension_deflection": 0.0 * path}
    channels = tuple(
        replace(c, time_s=time, value=values[c.sensor.kind], censored=np.zeros(time.size, bool))
        for kind in values
        for c in run.log.channels
        if c.sensor.kind == kind and c.sensor.axle == 1
    )
    slow = replace(run, log=replace(run.log, channels=channels))
    axle = replace(truck().vehicle.axles[1], tire_radius_m=0.5)
    vehicle = replace(truck().vehicle, axles=(truck().vehicle.axles[0], axle, *truck().vehicle.axles[2:]))
    case = next(iter(truck().load_cases.values()))
    # With the exponent 1.2 of the flat tire, a deflection of 20 mm is that of a stiffness of 1.2 F / u.
    load = case.axle_loads_kg[1] * vehicle.gravity_m_s2
    felt = effective_profiles(
        replace(vehicle, axles=tuple(replace(a, tire_stiffness_N_per_m=1.2 * load / 0.02) for a in vehicle.axles)),
        case, case, plank,
    )[1]  # fmt: skip
    found = wheels._rise(slow, Passage(1.5, {1: Arrival(2.0, 1, 0.01)}, 1), 1, plank, felt)
    assert found.height == pytest.approx(1.0, abs=0.15)
    assert found.left < wheels.HOPELESS


@pytest.mark.parametrize("factor", first_then_long(0.5, 2.0))
def test_a_scan_of_another_height_is_named(factor: float) -> None:
    scans = {n: replace(s, points_m=s.points_m * [1.0, 1.0, factor]) for n, s in truck().scans.items()}
    (found,) = re.findall(r"would have to be (\S+) times as high", said(replace(truck(), scans=scans)))
    assert float(found) == pytest.approx(1 / factor, rel=0.1)


@pytest.mark.parametrize("name", first_then_long("examples/linear_truck", "data"))
def test_a_heading_off_by_half_a_turn_is_named(name: str) -> None:
    scans = {n: replace(s, heading_rad=s.heading_rad + np.pi) for n, s in truck(name).scans.items()}
    assert "off by 180 degrees" in said(replace(truck(name), scans=scans))


def test_a_scan_in_millimetres_is_left_out_with_its_unit() -> None:
    scans = {n: replace(s, points_m=1e3 * s.points_m) for n, s in truck().scans.items()}
    screened, _ = check_quality(truck())
    found = check_bookkeeping(replace(screened, scans=scans), truck())
    assert len(found.left_out) == 1
    assert "looks like mm" in found.left_out[0]


@pytest.mark.parametrize("name", first_then_long("data", "examples/linear_truck"))
def test_drops_of_two_axles_exchanged_are_named(name: str) -> None:
    swap = {1: 2, 2: 1}
    drops = tuple(replace(d, axle=swap.get(d.axle, d.axle)) for d in truck(name).plank_drops)
    text = said(replace(truck(name), plank_drops=drops))
    assert "The drops of 'forward tandem drive' and 'rear tandem drive' are probably exchanged" in text
    # The names of the files tell the same.
    assert text.count("but its name says") == 6


def test_one_drop_of_another_axle_is_named() -> None:
    drops = list(truck().plank_drops)
    drops[0] = replace(drops[0], axle=3)
    assert f"{drops[0].log.file}: its suspension is compressed by 0.03" in said(
        replace(truck(), plank_drops=tuple(drops))
    )


@pytest.mark.parametrize("factor", first_then_long(0.5, 2.0))
def test_another_plank_height_is_named(factor: float) -> None:
    drops = tuple(replace(d, plank_height_m=factor * d.plank_height_m) for d in truck().plank_drops)
    (height,) = re.findall(r"about (\S+) m is expected", said(replace(truck(), plank_drops=drops)))
    assert float(height) == pytest.approx(0.075, rel=0.12)


def on_lower_plank(drop, factor: float):
    """A drop from a plank of another height: a linear suspension is compressed in proportion."""

    def lower(channel: Channel) -> Channel:
        if channel.sensor.kind != "suspension_deflection":
            return channel
        rest = np.nanmedian(channel.value[channel.time_s > channel.time_s[-1] - 0.7])
        return replace(channel, value=rest + factor * (channel.value - rest))

    log = replace(drop.log, channels=tuple(map(lower, drop.log.channels)))
    return replace(drop, log=log, plank_height_m=factor * drop.plank_height_m)


def test_planks_of_several_heights_are_no_mistake() -> None:
    drops = tuple(on_lower_plank(d, 0.5) if d.axle < 3 else d for d in truck().plank_drops)
    assert "plank_height_m" not in said(replace(truck(), plank_drops=drops))


@pytest.mark.parametrize(
    ("wrong", "names"),
    [((3,), ["first trailer"]), ((1, 2, 3), ["forward tandem drive", "rear tandem drive", "first trailer"])],
)
def test_only_the_axles_on_the_wrong_plank_are_named(wrong, names) -> None:
    """Few or most of the axles fell from 75 mm, listed as 150 mm; the others from 60 mm, as listed."""
    drops = tuple(
        replace(d, plank_height_m=2.0 * d.plank_height_m) if d.axle in wrong else on_lower_plank(d, 0.8)
        for d in truck().plank_drops
    )
    (line,) = [x for x in said(replace(truck(), plank_drops=drops)).splitlines() if "as high as listed" in x]
    assert [name for name in (a.name for a in truck().vehicle.axles) if f"'{name}'" in line] == names
    assert "plank_height_m is 0.15," in line
    (height,) = re.findall(r"about (\S+) m is expected", line)
    assert float(height) == pytest.approx(0.075, rel=0.12)


def test_a_filter_that_would_have_removed_the_motion_is_named() -> None:
    acquisition = truck().acquisition
    assert acquisition.filter is not None
    low = replace(acquisition, filter=replace(acquisition.filter, cutoff_hz=12.0))
    assert "correct acquisition.filter" in said(replace(truck(), acquisition=low))


def test_readings_that_stand_twice_are_named() -> None:
    first = truck().bump_runs[0]
    known = {c.sensor.column: c.value for c in first.log.channels}
    twice = with_channel(replace(truck(), bump_runs=(first,)), "lvdt2_mm", lambda y: known["lvdt5_mm"])
    assert "'lvdt2_mm' and 'lvdt5_mm' hold the same readings" in said(twice)
    copied = replace(truck().bump_runs[3], log=replace(first.log, file="other.csv"))
    assert f"other.csv holds the same readings as {first.log.file}" in said(
        replace(truck(), bump_runs=(*truck().bump_runs, copied))
    )


def test_a_mount_that_slips_is_named() -> None:
    def slipped(y: np.ndarray) -> np.ndarray:
        return y + 0.01 * (np.arange(y.size) > y.size // 2)

    text = said(with_channel(truck(), "lvdt3_mm", slipped))
    _, report = check_quality(with_channel(truck(), "lvdt3_mm", slipped))
    messages = [m for f in report.channels if f.column == "lvdt3_mm" for m in f.messages]
    # In most of the ten runs; in the others the truck does not stand still in the last second.
    assert sum("its mount has slipped" in m for m in messages) >= 7
    assert "lvdt3_mm' is rejected" not in text
