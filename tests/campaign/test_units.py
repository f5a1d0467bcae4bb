"""Factors of units, and units that files write."""

from __future__ import annotations

import re

import pint
import pytest

from sysid.campaign.units import (
    Dimension,
    angle_rad,
    contradiction,
    is_other_quantity,
    length_in_m,
    pressure_pa,
    recognised_unit,
    si_factor,
    speed_m_s,
    unit_in_brackets,
    unit_names,
)
from sysid.errors import CampaignError

#: What pint calls the units whose names it reads otherwise: "g" would be gram.
IN_PINT = {"g": "standard_gravity", "mg": "0.001 * standard_gravity"}
DIMENSIONS: dict[Dimension, str] = {
    "length": "m",
    "acceleration": "m/s^2",
    "speed": "m/s",
    "angle": "rad",
    "angular rate": "rad/s",
    "pressure": "Pa",
}


def by_pint(registry: pint.UnitRegistry[float], unit: str, si: str) -> float:
    written = IN_PINT.get(unit, re.sub(r"s2$", "s^2", unit.replace("²", "2").replace("°", "deg")))
    return float(registry(written).to(si).magnitude)


def test_factors_are_those_of_pint() -> None:
    registry = pint.UnitRegistry()
    for dimension, si in DIMENSIONS.items():
        for unit in unit_names(dimension):
            assert si_factor(unit, dimension) == pytest.approx(by_pint(registry, unit, si), rel=1e-14), unit
    # The US survey foot differs by 2 parts in a million.
    assert si_factor("ft", "length") != pytest.approx(by_pint(registry, "survey_foot", "m"), rel=1e-14)


@pytest.mark.parametrize(
    ("written", "metres"), [("[mm]", 1e-3), ("Inches", 0.0254), ("meters", 1.0), ("g", None), ("", None), ("s", None)]
)
def test_a_length_is_told_from_other_units(written: str, metres: float | None) -> None:
    assert length_in_m(written) == metres


@pytest.mark.parametrize(
    ("written", "declared", "found"),
    [
        (None, "mm", None),
        ("mm", "mm", None),
        # Other spellings of one unit, and units that the program does not know.
        ("Millimeter", "mm", None),
        ("[m/s**2]", "m/s^2", None),
        ("furlong", "mm", None),
        # Another size of one quantity, another quantity that is known, and one that no sensor here measures.
        ("cm", "mm", "cm"),
        ("g", "m/s^2", "g"),
        ("g", "mm", "g"),
        ("Volt", "mm", "Volt"),
    ],
)
def test_a_unit_in_a_file_contradicts_the_declared_one(written: str | None, declared: str, found: str | None) -> None:
    assert contradiction(written, declared) == found


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("axle 1 [mm]", "mm"),
        ("axle 1 (m/s^2) ", "m/s^2"),
        ("a [g]", "g"),
        ("a [m]", "m"),
        # One letter may be a place; what stands before other words is no unit.
        ("a [V]", None),
        ("a [mm] left", None),
        ("a", None),
        ("a (of many more words than a unit has)", None),
    ],
)
def test_what_stands_in_brackets_at_the_end_of_a_name_is_its_unit(name: str, unit: str | None) -> None:
    assert unit_in_brackets(name) == unit


def test_how_a_campaign_file_calls_the_unit_of_a_file() -> None:
    assert recognised_unit("metres") == ("m", "length")
    assert recognised_unit("gn") == ("g", "acceleration")
    assert recognised_unit("kmh") is None
    assert recognised_unit("kmh", ("speed",)) == ("km/h", "speed")
    assert recognised_unit("deg/sec", ("angular rate",)) == ("deg/s", "angular rate")
    assert recognised_unit("furlong") is None


def test_other_quantities_are_known_by_their_units() -> None:
    assert [w for w in ("V", "kPa", "Newton", "mm", "g", "") if is_other_quantity(w)] == ["V", "kPa", "Newton"]


def test_a_unit_of_another_dimension_is_refused_with_what_is_near() -> None:
    assert si_factor(" mm ", "length") == 1e-3
    with pytest.raises(CampaignError, match=r"'m/s3' is not a unit of acceleration; did you mean 'm/s.'"):
        si_factor("m/s3", "acceleration")


def test_values_of_a_campaign_file_in_si() -> None:
    assert speed_m_s(36.0) == pytest.approx(10.0)
    assert angle_rad(180.0) == pytest.approx(3.14159265358979)
    assert pressure_pa(800.0) == pytest.approx(8e5)
