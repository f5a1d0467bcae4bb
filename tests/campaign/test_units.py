"""Units of length that readers convert by themselves."""

from __future__ import annotations

import pint
import pytest

from sysid.campaign.units import LENGTH_IN_M, length_in_m, unit_names


def test_lengths_are_those_of_pint() -> None:
    registry = pint.UnitRegistry()
    assert set(LENGTH_IN_M) == set(unit_names("length"))
    for name, metres in LENGTH_IN_M.items():
        assert registry.Quantity(1.0, name).to("m").magnitude == pytest.approx(metres, rel=1e-12)


@pytest.mark.parametrize(
    ("written", "metres"), [("[mm]", 1e-3), ("Inches", 0.0254), ("meters", 1.0), ("g", None), ("", None), ("s", None)]
)
def test_a_length_is_told_from_other_units(written: str, metres: float | None) -> None:
    assert length_in_m(written) == metres
