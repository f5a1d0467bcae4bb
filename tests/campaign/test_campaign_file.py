"""The campaign file: what is read from it, and the sentence that each fault ends in."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tomllib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sysid.campaign import BumpShape, RoadCourse, read_campaign
from sysid.campaign.toml.reading import validate
from sysid.campaign.units import angle_rad, pressure_pa, si_factor, speed_m_s
from sysid.errors import CampaignError, DataRejectedError, SysidError
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.vehicle_model.passes import declared_tires
from sysid.vehicle_model.vibration_modes import natural_modes
from tests.support.small_campaign import LOG


def one_sentence(error: pytest.ExceptionInfo[SysidError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    assert text.endswith((".", "?"))
    assert len(text) < 700
    return text


def test_a_sprung_mass_that_follows_from_the_scales_need_not_be_given(small):
    campaign = read_campaign(small(("sprung_mass_kg = [6000]\n", "")))
    # 4000 + 3500 kg on the scales, less 500 + 1000 kg of axles.
    assert campaign.load_cases["empty"].sprung_mass_kg == (6000.0,)
    axle = '[[vehicle.axle]]\nname = "rear"\nbody = '
    trailer = '[[vehicle.body]]\nname = "trailer"\nhitch_x_m = 2.0\n'
    coupled = (f'{axle}"frame"', f'{trailer}{axle}"trailer"')
    lists = (
        "pitch_inertia_kg_m2 = [15000]\ncg_height_m = [1.0]",
        "pitch_inertia_kg_m2 = [9e3, 9e3]\ncg_height_m = [1, 1]",
    )
    with pytest.raises(
        CampaignError, match=r"load_case\.empty has no sprung_mass_kg; give one number per body"
    ) as error:
        read_campaign(small(("sprung_mass_kg = [6000]\n", ""), coupled, lists))
    one_sentence(error)


def test_a_frame_sensor_above_an_axle_takes_its_place(small):
    sensor = 'b_g = { kind = "body_acceleration", axle = "rear", unit = "g" }\na1_g'
    campaign = read_campaign(small(("a1_g", sensor), log=LOG.replace("a1_g", "a1_g,b_g").replace("0\n", "0,0\n")))
    (found,) = (c.sensor for c in campaign.bump_runs[0].log.channels if c.sensor.column == "b_g")
    assert (found.axle, found.body, found.x_m) == (None, 0, 4.0)
    for place in ('axle = "rear", x_m = 4', 'axle = "rear", body = "frame"', 'body = "frame"'):
        with pytest.raises(CampaignError, match="the axle above which it sits") as error:
            read_campaign(small(("a1_g", sensor.replace('axle = "rear"', place))))
        one_sentence(error)


def test_tests_take_a_common_load_case_unless_they_say_their_own(small):
    laden = ("[acquisition]", "[load_case.laden]\naxle_loads_kg = [5000, 9000]\npitch_inertia_kg_m2 = [2e4]\n"
             "cg_height_m = [1.2]\n[acquisition]")  # fmt: skip
    common = ("[tests]", '[tests]\nload_case = "laden"')
    own = read_campaign(small(laden, common)).bump_runs[0]
    said = read_campaign(small(laden, common, ('load_case = "empty", nominal', "nominal"))).bump_runs[0]
    assert (own.load_case, said.load_case) == ("empty", "laden")
    # Without a common one it is required, as before.
    with pytest.raises(CampaignError, match="load_case"):
        read_campaign(small(laden, ('load_case = "empty", nominal', "nominal")))


def test_linear_truck_in_si_units(linear_truck_folder):
    campaign = read_campaign(linear_truck_folder)
    assert campaign.title == "Virtual proving ground A: reference campaign"
    assert [a.x_m for a in campaign.vehicle.axles] == [0, 4.07, 5.39, 13.33, 14.63, 15.93]
    assert [a.body for a in campaign.vehicle.axles] == [0, 0, 0, 1, 1, 1]
    assert [a.load_dependent for a in campaign.vehicle.axles] == [False, True, True, False, False, False]
    assert campaign.vehicle.gravity_m_s2 == 9.81
    assert campaign.vehicle.bodies[1].hitch_x_m == 4.43
    assert list(campaign.load_cases) == ["unloaded", "loaded"]
    assert campaign.load_cases["loaded"].cargo_mass_kg == 39000
    assert (len(campaign.plank_drops), len(campaign.bump_runs), len(campaign.predictions)) == (18, 10, 2)
    assert campaign.bump_runs[0].nominal_speed_m_s == pytest.approx(16 / 3.6, rel=1e-15)
    assert campaign.predictions[0].speed_m_s == pytest.approx(48 / 3.6, rel=1e-15)
    assert campaign.scans["bump"].heading_rad == pytest.approx(4.3 * np.pi / 180, rel=1e-15)
    assert campaign.scans["bump"].points_m.shape == (0, 3)
    filter_ = campaign.acquisition.filter
    assert (filter_.kind, filter_.order, filter_.cutoff_hz) == ("butterworth", 4, 60)
    log = campaign.bump_runs[0].log
    by_name = {c.sensor.column: c for c in log.channels}
    # First data row of the file: 3.64 mm and -0.005 g; 1 g = 9.80665 m/s2.
    assert by_name["lvdt1_mm"].value[0] == pytest.approx(3.64e-3, rel=1e-12)
    assert by_name["axle1_accel_g"].value[0] == pytest.approx(-0.005 * 9.80665, rel=1e-12)
    assert by_name["axle1_accel_g"].sensor.full_scale == pytest.approx(98.0665, rel=1e-12)
    assert by_name["frame5_accel_g"].sensor.x_m == 14.63
    drop = campaign.plank_drops[3]
    assert (drop.axle, drop.load_case, drop.plank_height_m) == (1, "unloaded", 0.075)
    assert [(c.sensor.axle, c.sensor.body, c.sensor.x_m) for c in drop.log.channels] == [(1, 0, 4.07)] * 3
    scan = (linear_truck_folder / "bump_scan.csv").read_bytes()
    assert campaign.input_sha256["bump_scan.csv"] == hashlib.sha256(scan).hexdigest()
    assert len(campaign.input_sha256) == 18 + 10 + 1 + 1


@pytest.mark.parametrize(
    ("unit", "dimension", "factor"),
    [
        ("mm", "length", 1e-3),
        ("in", "length", 0.0254),
        ("g", "acceleration", 9.80665),
        ("mg", "acceleration", 9.80665e-3),
        ("m/s^2", "acceleration", 1.0),
        ("cm/s2", "acceleration", 0.01),
    ],
)
def test_unit_factors(unit, dimension, factor):
    assert si_factor(unit, dimension) == pytest.approx(factor, rel=1e-15)


def test_other_units():
    assert speed_m_s(36.0) == pytest.approx(10.0, rel=1e-15)
    assert angle_rad(180.0) == pytest.approx(np.pi, rel=1e-15)
    assert pressure_pa(800.0) == pytest.approx(8e5, rel=1e-15)


def test_how_the_speed_of_a_run_is_held_and_may_change(small):
    (plain,) = read_campaign(small()).bump_runs
    assert (plain.speed_held, plain.speed_change_sd) == ("servo", 0.02)
    line = "nominal_speed_km_h = 36"
    for value in (0.0, 0.05):
        file = small((line, f'{line}, speed_held = "cruise", speed_change_sd = {value}'))
        (run,) = read_campaign(file).bump_runs
        assert (run.speed_held, run.speed_change_sd) == ("cruise", value)
    for value in ("-0.01", "0.6", "nan", '"2 %"'):
        with pytest.raises(CampaignError, match="speed_change_sd"):
            read_campaign(small((line, f"{line}, speed_change_sd = {value}")))


def test_point_cloud_reader_gets_file_and_unit(small):
    calls = []

    def reader(path, unit):
        calls.append((path.name, unit))
        return np.ones((4, 3))

    campaign = read_campaign(small(("heading_deg = 90", 'heading_deg = 90\nunit = "mm"')), point_cloud_reader=reader)
    assert calls == [("scan.csv", "mm")]
    assert campaign.scans["bump"].points_m.shape == (4, 3)


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ("friction + spring_table", "but no spring_table; add it, or leave spring_table out"),
        ("damper_table", "but no damper_table; add it"),
        ("hanger_lash+friction", "but no hanger_lash_m; add it"),
        (
            'spring_table + hanger_lash"\nhanger_lash_m = 0.01\n'
            'spring_table = { extension_m = [-0.1, 0, 0.1], force_N = [-3e4, 0, 3e4] }\n#"',
            "has both spring_table and hanger_lash",
        ),
    ],
)
def test_a_law_needs_what_it_names(small, law, said):
    with pytest.raises(CampaignError, match=said) as error:
        read_campaign(small(('suspension = "leaf"', f'suspension = "leaf"\nsuspension_law = "{law}"')))
    assert "vehicle.axle[1] ('front') has" in str(error.value)


def test_optional_keys(small):
    file = small(
        ('name = "truck"', 'name = "truck"\ngravity_m_s2 = 9.79'),
        (
            'suspension = "leaf"',
            'suspension = "leaf"\njounce_travel_m = 0.08\nrebound_travel_m = 0.1\n'
            "leaf = { leaves = 8, width_m = 0.09, thickness_m = 0.012, length_m = 1.5 }\n"
            "priors = { stiffness_N_per_m = { median = 4e5, log_sd = 0.2 } }",
        ),
        ('suspension = "air"', 'suspension = "air"\ninflation_pressure_kPa = 830\nload_dependent = true'),
        (
            "[tests]",
            '[tests]\nplank_drop = [{ axle = "rear", file = "run.csv", plank_height_m = 0.08, load_case = "empty", '
            "nominal_speed_km_h = 5.4, dampers = false, towed = true, engine_off = true }]",
        ),
        (
            "[scan]",
            '[sensors.plank_drop]\nq1_mm = { kind = "suspension_deflection", unit = "mm" }\n\n[scan]',
        ),
    )
    campaign = read_campaign(file)
    front, rear = campaign.vehicle.axles
    assert campaign.vehicle.gravity_m_s2 == 9.79
    assert (front.leaf.leaves, front.leaf.length_m, front.jounce_travel_m) == (8, 1.5, 0.08)
    assert (front.priors["stiffness"].median, front.priors["stiffness"].log_sd) == (4e5, 0.2)
    assert (rear.load_dependent, rear.inflation_pressure_Pa) == (True, 830e3)
    drop = campaign.plank_drops[0]
    assert (drop.axle, drop.dampers, drop.towed, drop.engine_off) == (1, False, True, True)
    assert drop.nominal_speed_m_s == pytest.approx(1.5, rel=1e-15)
    assert any("more than one test" in m for m in campaign.messages)


@pytest.mark.parametrize(
    ("pressures", "factor"),
    [
        ("inflation_pressure_kPa = 600\ntire_stiffness_pressure_kPa = 800", 0.04 + 0.96 * 0.75),
        ("inflation_pressure_kPa = 600", 1.0),
        ("tire_stiffness_pressure_kPa = 800", 1.0),
    ],
)
def test_everybody_takes_the_tire_stiffness_at_the_pressure_of_the_tests(small, pressures, factor):
    """Affine in pressure with 4 % left at zero: prior, maps and modes see the same stiffness."""
    campaign = read_campaign(small(('suspension = "air"', f'suspension = "air"\n{pressures}')))
    expected = 2.9e6 * factor
    vehicle, case = campaign.vehicle, next(iter(campaign.load_cases.values()))
    prior = next(p for p in campaign_parameters(campaign, None).parameters if p.name == "kt_2")
    assert prior.prior_median == pytest.approx(expected, rel=1e-12)
    assert declared_tires(vehicle).stiffness_N_per_m[1] == pytest.approx(expected, rel=1e-12)
    rates = [np.full(2, v) for v in (4e5, 1e4)]
    assert natural_modes(vehicle, case, *rates).frequency_hz == pytest.approx(
        natural_modes(vehicle, case, *rates, np.array([1.6e6, expected])).frequency_hz, rel=1e-9
    )


def test_air_axle_is_not_load_dependent_with_one_load_case(small):
    assert [a.load_dependent for a in read_campaign(small()).vehicle.axles] == [False, False]


def test_order_of_axles_in_the_file_does_not_matter(small, tmp_path):
    first = read_campaign(small()).vehicle
    text = (tmp_path / "campaign.toml").read_text()
    head, front, rest = text.split("[[vehicle.axle]]")
    rear, tail = rest.split("[load_case")
    swapped = f"{head}[[vehicle.axle]]{rear}[[vehicle.axle]]{front}[load_case{tail}".replace(
        "[4000, 3500]", "[3500, 4000]"
    )
    campaign = read_campaign(small(toml=swapped))
    assert campaign.vehicle.axles == first.axles
    assert campaign.load_cases["empty"].axle_loads_kg == (4000, 3500)


def test_several_scans(small):
    scans = '[scan.short]\nfile = "scan.csv"\nheading_deg = 0\n[scan.long]\nfile = "scan.csv"\nheading_deg = 5'
    one = ('[scan]\nfile = "scan.csv"\nheading_deg = 90', scans)
    campaign = read_campaign(small(one, ("nominal_speed_km_h = 36", 'nominal_speed_km_h = 36, bump = "long"')))
    assert list(campaign.scans) == ["short", "long"]
    assert campaign.bump_runs[0].bump == "long"
    with pytest.raises(CampaignError, match="which bump") as error:
        read_campaign(small(one))
    one_sentence(error)
    with pytest.raises(CampaignError, match="did you mean 'long'"):
        read_campaign(small(one, ("nominal_speed_km_h = 36", 'nominal_speed_km_h = 36, bump = "longg"')))


def with_prediction(text: str) -> tuple[str, str]:
    return "[tests]", f"[tests]\nprediction = [{{ load_case = 'empty', speed_km_h = 48, {text} }}]"


def test_a_prediction_over_a_named_shape(small):
    change = with_prediction("shape = { name = 'trapezoid', height_m = 0.1, length_m = 6.0, top_m = 2.0 }")
    (request,) = read_campaign(small(change)).predictions
    assert request.shape == BumpShape("trapezoid", 0.1, 6.0, 2.0)
    assert request.bump == request.shape.label
    points = with_prediction("shape = { name = 'points', station_m = [0, 1, 2], heights_m = [0, 0.1, 0] }")
    (request,) = read_campaign(small(points)).predictions
    assert request.shape == BumpShape("points", station_m=(0.0, 1.0, 2.0), heights_m=(0.0, 0.1, 0.0))


def test_bumps_of_different_shape_have_different_names(small):
    shapes = ("[0, 0.1, 0]", "[0, 0.05, 0]", "[0, 0.1, 0]")
    entries = ", ".join(
        f"{{ load_case = 'empty', speed_km_h = {30 + i}, shape = {{ name = 'points', station_m = [0, 1, 2], "
        f"heights_m = {heights} }} }}"
        for i, heights in enumerate(shapes)
    )
    found = read_campaign(small(("[tests]", f"[tests]\nprediction = [{entries}]"))).predictions
    assert [r.bump for r in found] == ["points, 3 stations", "points, 3 stations (2)", "points, 3 stations"]


def test_a_prediction_over_the_profile_in_a_file(small):
    change = with_prediction("shape = { name = 'file', file = 'roads/hump.csv', lateral_m = -0.9 }")
    path = small(change)
    folder = path if path.is_dir() else path.parent
    with pytest.raises(CampaignError, match=r"tests.prediction\[1\].shape.file names 'roads/hump.csv'"):
        read_campaign(path)
    (folder / "roads").mkdir()
    (folder / "roads" / "hump.csv").write_text("station_m,height_m\n0,0\n1,0.1\n2,0\n")
    seen = []

    def reader(file, lateral_m, name):
        seen.append((file.name, lateral_m, name))
        return BumpShape("points", station_m=(0.0, 1.0, 2.0), heights_m=(0.0, 0.1, 0.0), source=name)

    campaign = read_campaign(path, profile_reader=reader)
    assert seen == [("hump.csv", -0.9, "roads/hump.csv")]
    assert campaign.predictions[0].bump == "roads/hump.csv"
    assert "roads/hump.csv" in campaign.input_sha256
    assert read_campaign(path).predictions[0].shape == BumpShape("points", source="roads/hump.csv")


def test_a_prediction_over_a_rough_road(small):
    change = with_prediction("road = { class = 'B', length_m = 500, seed = 1, realisations = 5 }")
    (request,) = read_campaign(small(change)).predictions
    road = request.road
    assert (road.roughness, road.length_m, road.seed, road.realisations) == ("B", 500.0, 1, 5)
    assert (request.bump, request.shape) == (road.label, None)


def test_a_prediction_over_a_measured_road(small):
    path = small(with_prediction("road = { file = 'lane.csv', lateral_m = 0.8, length_m = 20 }"))
    folder = path if path.is_dir() else path.parent
    (folder / "lane.csv").write_text("station_m,height_m\n0,0\n1,0.1\n2,0\n")
    seen = []

    def reader(file, lateral_m, name, length_m):
        seen.append((file.name, lateral_m, name, length_m))
        return RoadCourse(20.0, source=name)

    campaign = read_campaign(path, road_reader=reader)
    assert seen == [("lane.csv", 0.8, "lane.csv", 20.0)]
    assert campaign.predictions[0].bump == "lane.csv"
    assert "lane.csv" in campaign.input_sha256


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("road = { length_m = 500 }", "give one of class, file and parts"),
        ("road = { class = 'B' }", "give length_m"),
        ("road = { class = 'J', length_m = 500 }", "class"),
        ("road = { file = 'lane.csv', seed = 1 }", "seed and realisations belong to a class"),
        ("bump = 'bump', road = { class = 'B', length_m = 500 }", "has both bump and road"),
        ("road = { class = 'A', length_m = 30000 }", "length_m"),
    ],
)
def test_a_faulty_road_ends_in_one_sentence(small, text, said):
    with pytest.raises(CampaignError, match=said) as error:
        read_campaign(small(with_prediction(text)))
    assert "tests.prediction[1]" in one_sentence(error)


def test_a_road_that_takes_an_hour_is_refused(small):
    change = (
        "[tests]",
        ("[tests]\nprediction = [{ load_case = 'empty', speed_km_h = 5, road = { class = 'B', length_m = 9000 } }]"),
    )
    with pytest.raises(CampaignError, match="choose a higher speed or a shorter road"):
        read_campaign(small(change))


SHAPE_FAULTS = [
    ("shape = { name = 'file' }", "give file, lateral_m"),
    ("shape = { name = 'file', file = 'a.crg', height_m = 0.1 }", "and no size or points"),
    ("shape = { name = 'watts', height_m = 0.1, length_m = 3.7, file = 'a.crg' }", "belong to name = 'file'"),
    ("shape = { name = 'file', file = '../a.crg' }", "leads outside the campaign folder"),
    ("bump = 'bump', shape = { name = 'watts', height_m = 0.1, length_m = 3.7 }", "both bump and shape"),
    ("shape = { name = 'watts', height_m = 0.1 }", "give its height_m and length_m"),
    ("shape = { name = 'wats', height_m = 0.1, length_m = 3.7 }", "did you mean 'watts'"),
    ("shape = { name = 'watts', height_m = 0.1, length_m = 3.7, top_m = 1.0 }", "only a trapezoid"),
    ("shape = { name = 'points', station_m = [0, 1, 2], heights_m = [0, 0.1] }", "equally many"),
    ("shape = { name = 'points', station_m = [0, 1], heights_m = [0, 0.1] }", "three or more"),
    ("shape = { name = 'watts', height_m = 'high', length_m = 3.7 }", "expected a number"),
    ("shape = { name = 'trapezoid', height_m = 0.1, length_m = 1.0, top_m = 2.0 }", "shape has top_m = 2 on a length"),
    ("shape = { name = 'watts', height_m = 0.9, length_m = 0.5 }", "shape has height_m = 0.9 on a length_m of 0.5"),
    ("shape = { name = 'points', station_m = [0, 2, 1], heights_m = [0, 0.1, 0] }", "do not increase at point 3"),
    ("shape = { name = 'points', station_m = [0, 50, 100], heights_m = [0, 80, 0] }", "heights in metres"),
    ("shape = { name = 'points', station_m = [-100, 0, 100], heights_m = [0, 0.1, 0] }", "heights in metres"),
    ("shape = { name = 'points', station_m = [0, 1, 2], heights_m = [0, 0.0001, 0] }", "nowhere rises above 1 mm"),
    ("shape = { name = 'points', station_m = [0, 1, 2], heights_m = [0, 0.1, 0.1] }", "must lie on the road"),
    ("shape = { name = 'points', station_m = [0, 1e-4, 2e-4], heights_m = [0, 0.1, 0] }", "too short for stations"),
]


@pytest.mark.parametrize(("text", "said"), SHAPE_FAULTS)
def test_a_faulty_shape_ends_in_one_sentence(small, text, said):
    with pytest.raises(CampaignError, match=said) as error:
        read_campaign(small(with_prediction(text)))
    assert "tests.prediction[1]" in one_sentence(error)


@pytest.mark.parametrize(
    ("speed", "text", "said"),
    [
        ("0.05", "shape = { name = 'watts', height_m = 0.1, length_m = 3.7 }", "takes 554 s or more at 0.05 km/h"),
        ("0.05", "shape = { name = 'points', station_m = [1, 2, 3], heights_m = [0, 0.1, 0] }", "takes 432 s or more"),
        ("0.04", "bump = 'bump'", "takes 360 s or more"),
    ],
)
def test_a_pass_without_end_is_refused_when_the_file_is_read(small, speed, text, said):
    old, new = with_prediction(text)
    with pytest.raises(CampaignError, match=said) as error:
        read_campaign(small((old, new.replace("speed_km_h = 48", f"speed_km_h = {speed}"))))
    assert "tests.prediction[1].speed_km_h" in one_sentence(error)
    assert error.value.exit_code == 2


FAULTS = [
    ("unknown key", [("tire_radius_m = 0.5\nsuspension = \"leaf\"", "tyre_radius_m = 0.5\nsuspension = \"leaf\"")],
     ["vehicle.axle[1]", "'front'", "tyre_radius_m", "did you mean 'tire_radius_m'"]),
    ("unknown table", [("[acquisition]", "[aquisition]")], ["aquisition", "did you mean 'acquisition'"]),
    ("missing key", [("x_m = 4.0\n", "")], ["vehicle.axle[2]", "x_m", "missing"]),
    ("text for number", [("x_m = 4.0", 'x_m = "4.0"')],
     ["vehicle.axle[2].x_m", "'4.0'", "expected a number; write 4.0 without quotes"]),
    ("decimal comma in quotes", [("x_m = 4.0", 'x_m = "4,0"')], ["expected a number; write 4.0 without quotes"]),
    ("list in quotes", [("[4000, 3500]", '"4000, 3500"')], ["expected a list; write [4000, 3500] without quotes"]),
    ("no filter", [("[acquisition]\n", '[acquisition]\nfilter = "none"\n')],
     ["acquisition.filter", "'none'", "delete this line if there is none"]),
    ("decimal comma", [("x_m = 4.0", "x_m = 4,25")], ["not valid TOML", "line 25", "write a decimal point: 4.25"]),
    ("decimal comma among keys", [('axle = "front", unit = "g"', 'axle = "front", range = 2,5, unit = "g"')],
     ["not valid TOML", "write a decimal point: 2.5"]),
    ("decimal comma at the end", [('axle = "front", unit = "g"', 'axle = "front", unit = "g", range = 2,5')],
     ["not valid TOML", "write a decimal point: 2.5"]),
    ("path of Windows", [('"run.csv"', '"logs\\xrun.csv"')], ["not valid TOML", "write / in place of \\"]),
    ("number for text", [('title = "small"', "title = 3")], ["campaign.title", "3", "expected text in quotes"]),
    ("boolean for number", [("x_m = 4.0", "x_m = true")], ["x_m", "true", "expected a number"]),
    ("NaN", [("unsprung_mass_kg = 500", "unsprung_mass_kg = nan")], ["unsprung_mass_kg", "expected a finite number"]),
    ("negative mass", [("unsprung_mass_kg = 500", "unsprung_mass_kg = -5")],
     ["unsprung_mass_kg", "-5", "expected a number greater than or equal to 0"]),
    ("wrong choice", [('suspension = "leaf"', 'suspension = "leaff"')], ["'leaff'", "did you mean 'leaf'"]),
    ("schema 2", [("schema = 1", "schema = 2")], ["schema = 2", "schema = 1"]),
    ("no schema", [("schema = 1\n", "")], ["no schema"]),
    ("body name", [('name = "front"\nbody = "frame"', 'name = "front"\nbody = "fram"')],
     ["'fram'", "did you mean 'frame'"]),
    ("axle name", [('axle = "front", unit = "g"', 'axle = "frnt", unit = "g"')],
     ["sensors.bump_run.a1_g.axle", "did you mean 'front'"]),
    ("load case name", [('load_case = "empty"', 'load_case = "emtpy"')], ["tests.bump_run[1].load_case", "'empty'"]),
    ("unit", [('unit = "g"', 'unit = "G"')], ["a1_g", "'G'", "did you mean 'g'"]),
    ("unit of the other dimension", [('unit = "g"', 'unit = "mm"')], ["a1_g", "'mm'", "acceleration"]),
    ("sensor without place", [('axle = "front", unit = "g"', 'unit = "g"')],
     ["a1_g measures axle_acceleration; give the name of its axle"]),
    ("too few loads", [("[4000, 3500]", "[4000]")], ["axle_loads_kg has 1 numbers", "expected 2"]),
    ("masses do not add up", [("[4000, 3500]", "[4000, 3600]")],
     ["campaign.toml: load case 'empty'", "+100 kg", "sprung_mass_kg"]),
    ("two axles of one name", [('name = "rear"', 'name = "front"')], ["vehicle.axle", "'front'"]),
    ("two axles at one place", [("x_m = 4.0", "x_m = 0")], ["same x_m"]),
    ("x not from axle 1", [("x_m = 0\n", "x_m = 1.2\n")], ["x_m = 1.2", "expected 0"]),
    ("hitch of the first body", [('name = "frame"\n\n', 'name = "frame"\nhitch_x_m = 1\n\n')], ["hitch_x_m", "front"]),
    ("height without hitch", [('name = "frame"\n\n', 'name = "frame"\nhitch_height_m = 1\n\n')], ["hitch_height_m"]),
    ("no scan", [('[scan]\nfile = "scan.csv"\nheading_deg = 90\n', "")], ["tests.bump_run[1]", "[scan]"]),
    ("drop without sensors",
     [("[tests]", '[tests]\nplank_drop = [{axle="front", file="run.csv", plank_height_m=0.1}]')],
     ["[sensors.plank_drop]"]),
    *((name, [("[tests]", f"[tests]\nplank_drop = [{{ file = 'run.csv', {keys} }}]"),
              ("[scan]", '[sensors.plank_drop]\nq1_mm = { kind = "suspension_deflection", unit = "mm" }\n\n[scan]')],
       words) for name, keys, words in [
        ("drop without axle", "plank_height_m = 0.1", ["plank_drop[1]", "needs its axle"]),
        ("drop without height", 'axle = "front"', ["plank_height_m", "release = 'body'"]),
        ("body with a plank", 'axle = "front", release = "body", plank_height_m = 0.1', ["lets a body go"]),
        ("several axles on a plank", 'axles = ["front", "rear"], plank_height_m = 0.1', ["several axles on the plank"]),
        ("an axle twice", 'axles = ["front", "front"], release = "body"', ["twice"]),
        ("axle and axles", 'axle = "front", axles = ["rear"], release = "body"', ["give axle, or axles"]),
        ("sensor of no axle", 'axles = ["front", "rear"], release = "body"', ["q1_mm", "give it an axle"]),
        ("unknown release", 'axle = "front", release = "bodi"', ["did you mean 'body'"]),
    ]),
    ("absolute path", [('"run.csv"', '"/etc/passwd"')], ["tests.bump_run[1].file", "absolute"]),
    ("drive path", [('"run.csv"', '"C:/run.csv"')], ["absolute"]),
    ("parent path", [('"run.csv"', '"../run.csv"')], ["leads outside", "move the file"]),
    ("hidden parent path", [('"run.csv"', '"a/../../run.csv"')], ["leads outside"]),
    ("backslash", [('"run.csv"', "'logs\\run.csv'")], ["forward slashes"]),
    ("long name", [('"run.csv"', '"' + "a" * 300 + '.csv"')], ["304 characters"]),
    ("backslash that TOML reads", [('"run.csv"', '"logs\\run.csv"')], ["control characters", "/ between folders"]),
    ("control character", [('"run.csv"', '"run\\u0000.csv"')], ["control characters"]),
    ("missing file", [('"run.csv"', '"runn.csv"')], ["'runn.csv'", "did you mean 'run.csv'"]),
    ("another missing file", [('"run.csv"', '"slope.csv"')], ["'slope.csv'", "check the name, relative to"]),
    ("tires in inches", [("tire_radius_m = 0.5", "tire_radius_m = 19.7")], ["tire_radius_m", "2.5"]),
    ("emoji file", [('"run.csv"', '"\U0001f69a.csv"')], ["does not exist"]),
    ("directory", [('"run.csv"', '"."')], ["is a folder"]),
    ("number that is too long", [("x_m = 4.0", "x_m = " + "9" * 5000)], ["campaign.toml"]),
    ("huge number", [("x_m = 4.0", "x_m = 1" + "0" * 400)], ["x_m", "huge"]),
    ("deep nesting", [("[tests]", "deep = " + "[" * 5000 + "]" * 5000 + "\n[tests]")], ["nested too deeply"]),
    ("TOML syntax", [("x_m = 4.0", "x_m = = 4.0")], ["not valid TOML", "line 25, column 7"]),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "words"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS])
def test_faulty_campaign_file_ends_in_one_sentence(small, changes, words):
    with pytest.raises(CampaignError) as error:
        read_campaign(small(*changes))
    text = one_sentence(error)
    for word in words:
        assert word in text


def test_many_faults_are_reported_briefly(small):
    with pytest.raises(CampaignError) as error:
        read_campaign(small(("unsprung_mass_kg", "mass"), ("tire_radius_m", "wheel_radius_m")))
    text = one_sentence(error)
    assert "more" in text
    assert text.count("is not a known key") == 3


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_encodings_of_the_campaign_file(small, small_text, encoding):
    assert read_campaign(small(toml=small_text.encode(encoding))).title == "small"


def test_campaign_file_that_is_not_text(small):
    with pytest.raises(CampaignError, match="UTF-8") as error:
        read_campaign(small(toml=b'title = "\xff\xfa"'))
    one_sentence(error)


def test_missing_campaign_file_and_folder(tmp_path):
    for path in (tmp_path / "nowhere.toml", tmp_path, tmp_path / "a" / "b", "x" * 5000, "a\0b"):
        with pytest.raises(CampaignError) as error:
            read_campaign(path)
        one_sentence(error)


def test_a_file_with_a_hidden_ending_is_to_be_renamed(tmp_path):
    for name in ("a.toml", "campaign.toml.txt"):
        (tmp_path / name).write_text("", encoding="utf-8")
    with pytest.raises(
        CampaignError, match=r"the folder has campaign\.toml\.txt: rename it to campaign\.toml"
    ) as error:
        read_campaign(tmp_path)
    one_sentence(error)


def test_link_out_of_the_folder(small, tmp_path):
    file = small(log=None)
    outside = tmp_path.parent / f"{tmp_path.name}_outside.csv"
    outside.write_text("time_s,q1_mm\n0,1\n")
    os.symlink(outside, tmp_path / "run.csv")
    with pytest.raises(CampaignError, match="outside the campaign folder") as error:
        read_campaign(file)
    one_sentence(error)


def test_link_loop_and_pipe(small, tmp_path):
    file = small(log=None)
    os.symlink(tmp_path / "run.csv", tmp_path / "run.csv")
    with pytest.raises(CampaignError) as error:
        read_campaign(file)
    one_sentence(error)
    (tmp_path / "run.csv").unlink()
    os.mkfifo(tmp_path / "run.csv")
    with pytest.raises(CampaignError, match="not a regular file"):
        read_campaign(file)


def test_log_of_two_gigabytes_is_refused_at_once(small, tmp_path):
    file = small()
    with (tmp_path / "run.csv").open("r+b") as stream:
        stream.truncate(2_000_000_000)
    with pytest.raises(DataRejectedError, match="2000 MB") as error:
        read_campaign(file)
    one_sentence(error)


@settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2000), st.integers(0, 40), st.binary(max_size=12))
def test_damaged_campaign_file_never_ends_in_a_traceback(small, small_text, start, length, junk):
    raw = small_text.encode()
    file = small(toml=raw[:start] + junk + raw[start + length :])
    with contextlib.suppress(SysidError):
        read_campaign(file)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.floats(allow_nan=True) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=80, derandomize=True, deadline=None)
@given(
    st.sampled_from(["campaign", "vehicle", "load_case", "acquisition", "sensors", "scan", "tests", "other"]), VALUES
)
def test_wrong_tables_never_end_in_a_traceback(small_text, table, value):
    data = tomllib.loads(small_text)
    data[table] = value
    with contextlib.suppress(CampaignError):
        validate(data, "campaign.toml")


def test_priors_by_name_as_median_or_interval(small, small_text):
    lines = ["k_1 = { median_N_per_m = 9e5, log_sd = 0.3 }", '"k_2[empty]" = { interval90_N_per_m = [4e5, 9e5] }']
    lines.append("tire_exponent = { median = 1.2, log_sd = 0.05 }")
    priors = read_campaign(small(toml="\n".join([small_text, "[priors]", *lines]))).priors
    assert (priors["k_1"].median, priors["k_1"].log_sd, priors["k_1"].unit) == (9e5, 0.3, "N/m")
    # 5 % and 95 % of a lognormal with median 600,000: ln(9 / 4) / 2 = 1.645 sd.
    assert priors["k_2[empty]"].median == pytest.approx(6e5)
    assert priors["k_2[empty]"].log_sd == pytest.approx(0.4054651 / 1.6448536)
    assert priors["tire_exponent"].unit == "1"


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{ median_N_per_m = 9e5 }", "without log_sd"),
        ("{ log_sd = 0.3 }", "either a median with log_sd or a 90 % interval"),
        ("{ interval90_N_per_m = [9e5, 4e5] }", "lower end first"),
        ("{ interval90_N_per_m = [4e5, 9e5], log_sd = 0.2 }", "how wide"),
        ("{ median_N_per_m = -9e5, log_sd = 0.3 }", "greater than 0"),
        ("{ median_N_per_mm = 9e5, log_sd = 0.3 }", "did you mean 'median_N_per_m'"),
    ],
)
def test_a_prior_that_says_too_little_or_too_much(small, small_text, entry, said):
    with pytest.raises(CampaignError) as error:
        read_campaign(small(toml=f"{small_text}\n[priors]\nk_1 = {entry}\n"))
    assert said in one_sentence(error)
    assert "priors" in str(error.value)
