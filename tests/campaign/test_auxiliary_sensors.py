"""Sensors of speed, air pressure and pitch rate, and sensors that are not to be used: read, checked, said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import check_quality, read_campaign
from sysid.campaign.records import CampaignDetails
from sysid.campaign.units import contradiction, recognised_unit, si_factor
from sysid.errors import CampaignError, DataRejectedError

SENSORS = 'a1_g = { kind = "axle_acceleration", axle = "front", unit = "g", range = 10 }'
NOMINAL = ", nominal_speed_km_h = 36"


def log(**columns):
    """200 rows of the small campaign with more columns; a column of one cell per row, or a number for all."""
    head = ["time_s", "q1_mm", "a1_g", *columns]
    rows = [head]
    for i in range(200):
        more = [f"{c[i] if isinstance(c, list) else c}" for c in columns.values()]
        rows.append([f"{0.01 * i:.2f}", f"{i % 7}", f"{5.0 if i == 90 else 0.1 * (i % 5):.3f}", *more])
    return "\n".join(",".join(row) for row in rows) + "\n"


def with_sensors(*lines):
    return SENSORS, "\n".join([SENSORS, *lines])


# By hand from the definitions: mile 1609.344 m, pound-force 4.4482216152605 N per square inch of 0.0254 m squared.
@pytest.mark.parametrize(
    ("unit", "dimension", "factor"),
    [
        ("km/h", "speed", 1.0 / 3.6),
        ("mph", "speed", 1609.344 / 3600.0),
        ("knot", "speed", 1852.0 / 3600.0),
        ("bar", "pressure", 1e5),
        ("MPa", "pressure", 1e6),
        ("psi", "pressure", 4.4482216152605 / 0.0254**2),
        ("mbar", "pressure", 100.0),
        ("deg/s", "angular rate", 3.141592653589793 / 180.0),
        ("mrad/s", "angular rate", 1e-3),
    ],
)
def test_units(unit, dimension, factor):
    assert si_factor(unit, dimension) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("written", "declared", "found"),
    [
        ("kmh", "km/h", None),
        ("m/s", "km/h", "m/s"),
        ("bar", "kPa", "bar"),
        ("BAR", "bar", None),
        ("°/s", "deg/s", None),
        ("rad/s", "deg/s", "rad/s"),
        ("bar", "mm", "bar"),
        ("furlong", "km/h", None),
    ],
)
def test_units_that_a_file_writes(written, declared, found):
    assert contradiction(written, declared) == found


def test_other_dimensions_are_recognised_when_asked_for():
    assert recognised_unit("psi") is None
    assert recognised_unit("psi", ("pressure",)) == ("psi", "pressure")


def test_every_new_kind_is_read_in_si_and_shown_by_the_check(small):
    file = small(
        with_sensors(
            'v = { kind = "speed", unit = "mph" }',
            'p = { kind = "air_pressure", axle = "rear", unit = "bar", area_m2 = 0.08 }',
            'w = { kind = "pitch_rate", body = "frame", unit = "deg/s", sign = -1 }',
        ),
        log=log(v=22.369362920544, p=6.0, w=[90.0 if i == 100 else 0.01 * (i % 3) for i in range(200)]),
    )
    (run,) = read_campaign(file).bump_runs
    assert [c.sensor.kind for c in run.log.channels] == ["suspension_deflection", "axle_acceleration", "pitch_rate"]
    speed, pressure = run.log.auxiliary
    rate = run.log.channels[2]
    assert speed.value[0] == pytest.approx(10.0, rel=1e-9)
    assert pressure.value[0] == pytest.approx(6e5, rel=1e-12)
    assert (pressure.sensor.axle, pressure.sensor.area_m2) == (1, 0.08)
    assert rate.value[100] == pytest.approx(-np.pi / 2, rel=1e-12)
    cleaned, report = check_quality(read_campaign(file))
    assert len(cleaned.bump_runs[0].log.auxiliary) == 2
    found = {f.column: f for f in report.channels}
    assert [found[c].verdict for c in "vp"] == ["good", "good"]
    assert found["w"].si_unit == "rad/s"
    assert found["p"].rest_level == pytest.approx(6e5)
    # Nothing is dropped in silence.
    assert report.logged_speeds_m_s == pytest.approx({"run.csv": 10.0})
    assert any("'p'" in message for message in report.messages)


def test_slow_sensors_leave_the_sample_interval_alone(small):
    # One reading per second between empty cells, on the clock of the others.
    gps = [36.0 if i % 100 == 0 else "" for i in range(200)]
    file = small(with_sensors('v = { kind = "speed", unit = "km/h" }'), log=log(v=gps))
    (run,) = read_campaign(file).bump_runs
    assert run.log.sample_interval_s == 0.01
    assert np.isfinite(run.log.auxiliary[0].value).sum() == 2
    _, report = check_quality(read_campaign(file))
    assert next(f for f in report.channels if f.column == "v").verdict == "good"


@pytest.mark.parametrize(
    ("line", "columns", "said"),
    [
        ('v = { kind = "speed", unit = "m/s" }', {"v": 250.0}, "no speed of a truck"),
        ('v = { kind = "speed", unit = "m/s" }', {"v": 0.0}, "stands still"),
        ('v = { kind = "speed", unit = "m/s" }', {"v": ""}, "empty"),
        ('p = { kind = "air_pressure", axle = "rear", unit = "bar" }', {"p": 600.0}, "no air pressure of a truck"),
        ('w = { kind = "pitch_rate", body = "frame", unit = "rad/s" }', {"w": 0.5}, "does not change"),
    ],
)
def test_what_no_sensor_of_a_truck_reads_is_rejected(small, line, columns, said):
    cleaned, report = check_quality(read_campaign(small(with_sensors(line), log=log(**columns))))
    found = next(f for f in report.channels if f.column in columns)
    assert found.verdict == "rejected"
    assert said in " ".join(found.messages)
    assert cleaned.bump_runs[0].log.auxiliary == ()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('v = { kind = "speed", unit = "km/h", axle = "front" }', "leave out axle, body and x_m"),
        ('w = { kind = "pitch_rate", unit = "deg/s" }', "give the name of its body"),
        ('w = { kind = "pitch_rate", unit = "deg/s", axle = "front", body = "frame" }', "body instead of axle"),
        ('p = { kind = "air_pressure", unit = "bar" }', "give the name of its axle"),
        ('p = { kind = "air_pressure", axle = "rear", unit = "mm" }', "not a unit of pressure"),
        ('w = { kind = "pitch_rate", body = "frame", unit = "deg" }', "not a unit of angular rate"),
        ('v = { kind = "speed", unit = "km/h", area_m2 = 0.1 }', "area_m2 belongs to air_pressure"),
        ('v = { unit = "km/h" }', "has no kind"),
        ('v = { kind = "speed" }', "has no unit"),
        ('v = { unused = "" }', "unused"),
    ],
)
def test_a_place_or_unit_that_does_not_fit_the_kind_is_refused(small, line, said):
    with pytest.raises(CampaignError, match=said):
        read_campaign(small(with_sensors(line), log=log(v=36, p=6, w=0)))


def test_a_unit_of_the_file_against_the_declared_one(small):
    head, rows = log(v=10.0).split("\n", 1)
    units_row = "sample_interval_s = 0.01", "sample_interval_s = 0.01\nunits_row = true"
    sensor = with_sensors('v = { kind = "speed", unit = "km/h" }')
    file = small(sensor, units_row, log=f"{head}\ns,mm,g,m/s\n{rows}")
    with pytest.raises(DataRejectedError, match=r"'v' is in 'm/s', campaign.toml says 'km/h'"):
        read_campaign(file)


def test_unused_columns_are_named_with_their_reason(small):
    lines = (
        'oil = { unused = "temperature" }',
        'spare = { kind = "axle_acceleration", axle = "rear", unit = "g", unused = "cable broke in run 3" }',
    )
    campaign = read_campaign(small(with_sensors(*lines), log=log(oil=80, spare=1)))
    assert {c.sensor.column for c in campaign.bump_runs[0].log.channels} == {"q1_mm", "a1_g"}
    said = " ".join(campaign.messages)
    assert "'oil'" in said
    assert "temperature" in said
    assert "'spare'" in said
    assert "cable broke in run 3" in said
    # Without the key, the column is a sensor.
    used = read_campaign(
        small(with_sensors(lines[1].replace(', unused = "cable broke in run 3"', "")), log=log(spare=1))
    )
    assert "spare" in {c.sensor.column for c in used.bump_runs[0].log.channels}


def test_the_logged_speed_stands_in_for_one_that_is_not_listed(small):
    # 36 km/h where the truck shakes most (row 90), 72 km/h long before.
    fast = [72.0 if i < 40 else 36.0 for i in range(200)]
    line = with_sensors('v = { kind = "speed", unit = "km/h" }')
    (run,) = read_campaign(small(line, (NOMINAL, ""), log=log(v=fast))).bump_runs
    assert run.nominal_speed_m_s == pytest.approx(10.0, rel=1e-12)
    for lost in (log(v=0.0), log()):
        with pytest.raises(CampaignError, match="no nominal_speed_km_h, and no sensor of kind 'speed'"):
            read_campaign(small(line, (NOMINAL, ""), log=lost))


def test_left_and_right_of_a_bellows_are_averaged(small):
    lines = [
        f'p{side[0]} = {{ kind = "air_pressure", axle = "rear", unit = "bar", side = "{side}" }}'
        for side in ("left", "right")
    ]
    (run,) = read_campaign(small(with_sensors(*lines), log=log(pl=6.0, pr=6.4))).bump_runs
    (mean,) = run.log.auxiliary
    assert mean.value[0] == pytest.approx(6.2e5)
    assert not any("differ" in m for m in run.log.messages)
    (apart,) = read_campaign(small(with_sensors(*lines), log=log(pl=2.0, pr=6.4))).bump_runs
    assert any("differ" in m for m in apart.log.messages)


def test_a_record_without_new_kinds_has_no_auxiliary_channels(small):
    campaign, report = check_quality(read_campaign(small(log=log())))
    assert campaign.bump_runs[0].log.auxiliary == ()
    assert not any("do not use it yet" in message for message in report.messages)


def test_what_the_campaign_says_of_the_test(small):
    said = 'date = 2026-05-04\nplace = "Tallahassee"\noperator = "JW"\nvehicle_id = "LB-7"\nsynthetic = true'
    details = read_campaign(small(('title = "small"', f'title = "small"\n{said}'))).details
    assert details == CampaignDetails("2026-05-04", "Tallahassee", "JW", "LB-7", True)
    quoted = read_campaign(small(('title = "small"', 'title = "small"\ndate = "2026-05-04"'))).details
    assert quoted == CampaignDetails("2026-05-04")
    assert read_campaign(small()).details == CampaignDetails()
    with pytest.raises(CampaignError, match=r"campaign\.date is no date; write it as 2026-05-31"):
        read_campaign(small(('title = "small"', 'title = "small"\ndate = "4 May"')))


@pytest.mark.parametrize("folder", ["data", "examples/linear_truck"])
def test_the_shipped_campaigns_say_that_they_are_synthetic(folder):
    assert read_campaign(Path(__file__).parents[2] / folder, planned=True).details.synthetic


@pytest.mark.parametrize(("clock", "known"), [("shared", True), ("per_log", False), ("continuous", False)])
def test_a_logger_of_speed_alone_needs_a_shared_clock(small, clock, known):
    """A GPS that runs beside the logger: its readings say nothing of when the truck meets the bump."""
    loggers = f'[[logger]]\nname = "main"\n\n[[logger]]\nname = "gps"\nclock = "{clock}"\n\n[sensors.bump_run]'
    sensors = with_sensors('v = { kind = "speed", unit = "km/h", logger = "gps" }')
    files = 'file = "run.csv"', 'files = { main = "run.csv", gps = "gps.csv" }'
    toml = small(("[sensors.bump_run]", loggers), sensors, files, log=log())
    rows = "".join(f"{0.1 * i:.1f},36\n" for i in range(20))
    (toml.parent / "gps.csv").write_text(f"time_s,v\n{rows}", encoding="utf-8")
    campaign = read_campaign(toml)
    (run,) = campaign.bump_runs
    assert [c.sensor.kind for c in run.log.auxiliary] == (["speed"] if known else [])
    assert run.log.sample_interval_s == 0.01
    assert any("cannot be compared" in c.complaint for c in campaign.clocks) is not known
