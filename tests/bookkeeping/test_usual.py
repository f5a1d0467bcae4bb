"""Values that follow from declared numbers, computed by hand for one truck, and the numbers named that are wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from sysid.bookkeeping.elimination import Derived, sentences
from sysid.bookkeeping.usual import MASSES, declared_values
from sysid.campaign.priors import NamedPrior, PriorOverride
from sysid.campaign.records import Acquisition, AntiAliasFilter, Campaign, PredictionRequest
from sysid.campaign.vehicle_records import (
    Axle,
    AxleGroup,
    Body,
    ForceTable,
    FrameBending,
    LeafDimensions,
    LoadCase,
    MassTolerances,
    Vehicle,
)

FRONT = Axle("front", 0, 0.0, 600.0, 1.8e6, 2600.0, 0.5, "leaf", jounce_travel_m=0.08, rebound_travel_m=0.09)
REAR = Axle("rear", 0, 4.0, 1100.0, 3.1e6, 3400.0, 0.52, "air")
TRAILER = Axle("trailer", 1, 11.0, 750.0, 1.9e6, 2600.0, 0.49, "air")
VEHICLE = Vehicle("truck", (Body("tractor"), Body("semi", 3.5, 1.15)), (FRONT, REAR, TRAILER))
EMPTY = LoadCase("empty", (5000.0, 4000.0, 3000.0), (5300.0, 4250.0), (15e3, 40e3), (1.0, 1.3))
LADEN = LoadCase("laden", (6000.0, 9000.0, 8000.0), (5300.0, 15250.0), (15e3, 120e3), (1.0, 1.8))

#: A spring of 500 kN/m over 140 mm, and a damper of 12 kN s/m over 1.2 m/s, in mm and mm/s.
SPRING = ForceTable((-70.0, 0.0, 70.0), (-35e3, 0.0, 35e3))
DAMPER = ForceTable((-600.0, 0.0, 600.0), (-7.2e3, 0.0, 7.2e3))


def campaign(vehicle: Vehicle = VEHICLE, empty: LoadCase = EMPTY, laden: LoadCase = LADEN, **changes) -> Campaign:
    right = Campaign(
        title="",
        notes="",
        folder=Path(),
        file=Path("campaign.toml"),
        vehicle=vehicle,
        load_cases={"empty": empty, "laden": laden},
        acquisition=Acquisition(0.005, AntiAliasFilter("butterworth", 4, 60.0)),
        plank_drops=(),
        bump_runs=(),
        scans={},
        predictions=(PredictionRequest("empty", 40.0 / 3.6),),
        input_sha256={},
    )
    return replace(right, **changes)


def with_axle(**changes: object) -> Vehicle:
    return replace(VEHICLE, axles=(replace(FRONT, **changes), REAR, TRAILER))  # type: ignore[arg-type]


def value(what: str, of: Campaign) -> Derived:
    (found,) = [d for d in declared_values(of) if d.what.startswith(what)]
    return found


def test_a_right_truck_has_the_values_computed_by_hand() -> None:
    right = campaign()
    assert sentences(declared_values(right), [MASSES]) == []
    # 9.81 * 5000 / 1.8e6; sqrt(3.1e6 / 1100) / (2 pi); 2600 / (2 sqrt(1.9e6 * 750)).
    sag = value("the tires of 'front' are compressed in load case 'empty'", right)
    assert sag.value == pytest.approx(27.25, abs=0.01)
    assert value("the axle 'rear' hops", right).value == pytest.approx(8.449, abs=0.001)
    assert value("the damping ratio of the tires of 'trailer'", right).value == pytest.approx(0.03444, abs=1e-5)
    # sqrt(15e3 / 5300) over 4.0 m, and sqrt(120e3 / 15250) over 11.0 - 3.5 m.
    gyration = value("the radius of gyration of 'tractor' in load case 'empty'", right)
    assert gyration.value == pytest.approx(0.4206, abs=1e-4)
    assert value("the radius of gyration of 'semi' in load case 'laden'", right).value == pytest.approx(
        0.3740, abs=1e-4
    )
    assert value("the pitch inertia of 'semi'", right).value == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (campaign(with_axle(tire_stiffness_N_per_m=1.8e3)), "tire_stiffness_N_per_m of 'front' (1800), as if given"),
        (campaign(with_axle(tire_stiffness_N_per_m=1.8e9)), "tire_stiffness_N_per_m of 'front' (1.8e+09)"),
        (campaign(with_axle(tire_damping_N_s_per_m=2.6e6)), "tire_damping_N_s_per_m of 'front' (2.6e+06)"),
        (campaign(with_axle(tire_radius_m=1.0)), "tire_radius_m of 'front' (1), as if given as a diameter"),
        (campaign(with_axle(tire_radius_m=0.05)), "tire_radius_m of 'front' (0.05)"),
        (campaign(with_axle(jounce_travel_m=0.8)), "jounce_travel_m of 'front' (0.8)"),
        (campaign(with_axle(rebound_travel_m=0.0009)), "rebound_travel_m of 'front' (0.0009)"),
        (campaign(with_axle(inflation_pressure_Pa=8e3)), "inflation_pressure_kPa of 'front' (8), as if given in bar"),
        (
            campaign(with_axle(leaf=LeafDimensions(3, 0.09, 0.0005, 1.5))),
            "leaf.thickness_m of 'front' (0.0005)",
        ),
        (
            campaign(with_axle(priors={"stiffness": PriorOverride(4e5, 9.0)})),
            "priors.stiffness.log_sd of 'front' (9)",
        ),
        (
            campaign(laden=replace(LADEN, pitch_inertia_kg_m2=(30e3, 120e3))),
            "pitch_inertia_kg_m2 of 'tractor' in load case 'laden' (30000)",
        ),
        # Cargo cannot make a trailer easier to turn.
        (
            campaign(laden=replace(LADEN, pitch_inertia_kg_m2=(15e3, 120.0))),
            "pitch_inertia_kg_m2 of 'semi' in load case 'laden' (120), as if given in t m2",
        ),
        (
            campaign(empty=replace(EMPTY, pitch_inertia_kg_m2=(15e3, 40.0))),
            "pitch_inertia_kg_m2 of 'semi' in load case 'empty' (40), as if given in t m2",
        ),
        (campaign(laden=replace(LADEN, cg_height_m=(1.0, 5.9))), "cg_height_m of 'semi' in load case 'laden' (5.9)"),
        (
            campaign(replace(VEHICLE, bodies=(Body("tractor"), Body("semi", 3.5, 3.77)))),
            "hitch_height_m of 'semi' (3.77), as if given in feet",
        ),
        (
            campaign(replace(VEHICLE, bodies=(Body("tractor", bending=FrameBending(50.0, 0.02)), VEHICLE.bodies[1]))),
            "bending.frequency_hz of 'tractor' (50)",
        ),
        (
            campaign(acquisition=Acquisition(0.005, AntiAliasFilter("butterworth", 4, 0.06))),
            "cutoff_hz of acquisition.filter (0.06), as if given in kHz",
        ),
        (campaign(predictions=(PredictionRequest("empty", 40.0),)), "speed_km_h of tests.prediction[1] (144)"),
        (campaign(predictions=(PredictionRequest("empty", 0.5),)), "speed_km_h of tests.prediction[1] (1.8)"),
        (
            campaign(replace(VEHICLE, bodies=(Body("tractor"), Body("semi", 3.5, 1.15 / 3.6)))),
            "hitch_height_m of 'semi' (0.319444)",
        ),
        (campaign(replace(VEHICLE, bodies=(Body("tractor"), Body("semi", 5.2, 1.15)))), "hitch_x_m of 'semi' (5.2)"),
        (campaign(with_axle(spring_table=SPRING)), "spring_table.extension_m of 'front' (140), as if given in mm"),
        (campaign(with_axle(damper_table=DAMPER)), "damper_table.rate_m_s of 'front' (1200), as if given in mm/s"),
        (
            campaign(with_axle(priors={"stiffness": PriorOverride(4e2, 0.3)})),
            "median of priors.stiffness_N_per_m of 'front' (400), as if given in N/mm",
        ),
        (campaign(priors={"k_2": NamedPrior(4e8, 0.3, "N/m")}), "priors.k_2.median_N_per_m (4e+08)"),
        (campaign(priors={"c_1": NamedPrior(15.0, 0.3, "N s/m")}), "priors.c_1.median_N_s_per_m (15)"),
        (campaign(priors={"F_1": NamedPrior(1.2, 0.3, "N")}), "priors.F_1.median_N (1.2)"),
        (campaign(priors={"kt_1": NamedPrior(9e5 / 1.1, 0.3, "N/m")}), "priors.kt_1.median_N_per_m (818182)"),
        (campaign(priors={"k_2": NamedPrior(4e5, 20.0, "N/m")}), "priors.k_2.log_sd (20)"),
        (
            campaign(replace(VEHICLE, tolerances=MassTolerances(axle_load=0.5))),
            "tolerances.axle_load (0.5)",
        ),
    ],
)  # fmt: skip
def test_a_wrong_number_is_named_and_no_other(wrong: Campaign, named: str) -> None:
    (sentence,) = sentences(declared_values(wrong), [MASSES])
    assert named in sentence
    assert sentence.startswith(named) or sentence.startswith("Either ")


def test_a_beam_of_no_size_is_named() -> None:
    beam = AxleGroup("beam", (0, 1), 400.0, 0.3)
    (sentence,) = sentences(declared_values(campaign(replace(VEHICLE, groups=(beam,)))), [MASSES])
    # sqrt(0.3 / 400) over 4 m.
    assert "pitch_inertia_kg_m2 of 'beam' (0.3)" in sentence
    assert "is 0.00685, 0.05 to 2 is usual" in sentence


def test_axles_whose_wheels_would_touch_are_named() -> None:
    # 0.4 m between wheels of 0.5 m and 0.52 m.
    near = replace(VEHICLE, axles=(FRONT, replace(REAR, x_m=0.4), TRAILER))
    said = sentences(declared_values(campaign(near)), [MASSES])
    assert any(s.startswith("x_m of 'rear' (0.4)") and "is 0.392, at least 0.9 is usual" in s for s in said)


def test_tables_priors_and_tolerances_that_are_right_say_nothing() -> None:
    spring = ForceTable((-0.07, 0.0, 0.07), (-35e3, 0.0, 35e3))
    damper = ForceTable((-0.6, 0.0, 0.6), (-3e3, 0.0, 9e3))
    right = campaign(
        replace(
            with_axle(spring_table=spring, damper_table=damper), tolerances=MassTolerances(0.1, 0.2, 0.1, 0.1, 0.02)
        ),
        priors={"k_2[laden]": NamedPrior(9e5, 0.3, "N/m"), "tire_exponent": NamedPrior(1.2, 0.03, "1")},
    )
    assert sentences(declared_values(right), [MASSES]) == []
    # sqrt(5e5 / sqrt(4400 * 5400)) / (2 pi), with 5000 - 600 and 6000 - 600 kg.
    assert value("on its spring_table, 'front' bounces at", right).value == pytest.approx(1.612, abs=1e-3)


def test_a_hitch_that_carries_most_of_its_body_is_named_with_the_masses() -> None:
    """What the axles of the trailer carry less than it weighs hangs on its hitch."""
    heavy = campaign(empty=replace(EMPTY, sprung_mass_kg=(2500.0, 7050.0)))
    # 1 + (7050 - (3000 - 750)) / 7050.
    assert value("one and the load on the hitch", heavy).value == pytest.approx(1.6809, abs=1e-4)
    assert any(
        "sprung_mass_kg" in s and "on the hitch of 'semi'" in s for s in sentences(declared_values(heavy), [MASSES])
    )
