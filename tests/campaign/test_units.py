"""Factors of units, and units that files write."""

from __future__ import annotations

import re

import pint
import pytest

from sysid.campaign.units import Dimension, length_in_m, si_factor, unit_names

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
