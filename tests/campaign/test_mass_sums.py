"""Masses that contradict each other: the wrong one is found by elimination.

The trucks are written by hand, and what is wrong is known because the test made it so.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from sysid.campaign.mass_sums import check_masses
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.errors import CampaignError


def axle(name: str, body: int, x_m: float, unsprung_kg: float) -> Axle:
    return Axle(name, body, x_m, unsprung_kg, 2e6, 3e3, 0.5, "leaf")


#: 6000 + 4000 = 500 + 1000 + 8500 empty, 7000 + 11000 = 500 + 1000 + 16500 laden.
TRUCK = Vehicle("truck", (Body("frame"),), (axle("front", 0, 0.0, 500.0), axle("rear", 0, 4.5, 1000.0)))
EMPTY = LoadCase("empty", (6000.0, 4000.0), (8500.0,), (2e4,), (1.1,))
LADEN = LoadCase("laden", (7000.0, 11000.0), (16500.0,), (4e4,), (1.5,))
CASES = {"empty": EMPTY, "laden": LADEN}


def unsprung(*masses: float) -> Vehicle:
    return replace(TRUCK, axles=tuple(replace(a, unsprung_mass_kg=m) for a, m in zip(TRUCK.axles, masses, strict=True)))


def said(vehicle: Vehicle = TRUCK, cases: dict[str, LoadCase] = CASES) -> str:
    with pytest.raises(CampaignError) as caught:
        check_masses(vehicle, cases)
    return str(caught.value)


def test_masses_that_agree_are_not_accused() -> None:
    check_masses(TRUCK, CASES)
    # 0.4 % of 18000 kg is what scales may be off.
    check_masses(TRUCK, {"empty": EMPTY, "laden": replace(LADEN, axle_loads_kg=(7000.0, 11070.0))})


@pytest.mark.parametrize(
    ("vehicle", "cases", "named"),
    [
        (
            unsprung(500.0, 1.0),
            CASES,
            "unsprung_mass_kg of 'rear' is 1, where about 1000 is expected, as if given in t",
        ),
        (unsprung(1102.31, 1000.0), CASES, "unsprung_mass_kg of 'front' is 1102.31, where about 500 is expected"),
        # More than the load that it is part of: the load is right, as the other load case says.
        (
            unsprung(500.0, 25400.0),
            CASES,
            "unsprung_mass_kg of 'rear' is 25400, where about 1000 is expected. Correct it.",
        ),
        (
            TRUCK,
            {"empty": EMPTY, "laden": replace(LADEN, axle_loads_kg=(7000.0, 24250.8))},
            "axle_loads_kg of 'rear' in load case 'laden' is 24250.8, where about 11000 is expected, as if given in lb",
        ),
        (
            TRUCK,
            {"empty": replace(EMPTY, sprung_mass_kg=(8.5,)), "laden": LADEN},
            "sprung_mass_kg of 'frame' in load case 'empty' is 8.5, where about 8500 is expected, as if given in t",
        ),
        (unsprung(0.5, 1.0), CASES, "all unsprung_mass_kg are 0.001 times what is expected, as if given in t"),
    ],
)
def test_the_wrong_mass_is_named_with_its_factor(vehicle: Vehicle, cases: dict[str, LoadCase], named: str) -> None:
    sentence = said(vehicle, cases)
    assert named in sentence
    assert "either" not in sentence


def test_masses_that_explain_alike_are_all_named() -> None:
    # 500 kg too much: either axle has 1000 kg in place of 500 kg.
    sentence = said(unsprung(1000.0, 1000.0))
    assert "either unsprung_mass_kg of '" in sentence
    assert all(
        f"unsprung_mass_kg of '{name}' is 1000, where about 500 is expected" in sentence for name in ("front", "rear")
    )
    # 9000 kg less: half of the loads, or sprung masses times 2.2.
    sentence = said(cases={"empty": EMPTY, "laden": replace(LADEN, axle_loads_kg=(3500.0, 5500.0))})
    assert "all axle_loads_kg of load case 'laden' are 0.5 times what is expected, as if given of one side" in sentence
    assert "sprung_mass_kg of 'frame' in load case 'laden' is 16500, where about 7500 is expected" in sentence


def test_a_difference_that_no_factor_explains_names_what_must_agree() -> None:
    sentence = said(TRUCK, {"empty": replace(EMPTY, sprung_mass_kg=(8800.0,)), "laden": LADEN})
    assert "a difference of -300 kg; correct axle_loads_kg, sprung_mass_kg or unsprung_mass_kg" in sentence
