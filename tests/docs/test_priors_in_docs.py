"""The page on estimation states the priors that the code has."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sysid.estimation.parameters.suspension_elements import ELEMENTS, ElementQuantity

PAGE = (Path(__file__).parents[2] / "docs" / "estimation.md").read_text(encoding="utf-8")
QUANTITIES = {q.quantity: q for element in ELEMENTS.values() for q in element.quantities}


@pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=QUANTITIES)
def test_parameters_of_elements_stand_in_the_table_of_priors(quantity: ElementQuantity) -> None:
    name = quantity.symbol if quantity.shared else f"{quantity.symbol}_i"
    rows = [line for line in PAGE.splitlines() if line.startswith("|") and f"`{name}`" in line]
    assert len(rows) == 1
    assert float(rows[0].split("|")[-2]) == quantity.sd


def test_medians_of_elements_stand_in_the_table_of_priors() -> None:
    """Those that do not depend on the axle, in the words of the table."""
    expected = {"slip_length", "damper_asymmetry", "damper_knee", "damper_rounding", "damper_tail", "progressivity"}
    expected |= {"stroke_stiffening", "stop_stiffness", "bushing_stiffness"}
    expected |= {"helper_stiffness", "helper_travel"}
    for quantity in (QUANTITIES[name] for name in expected):
        name = quantity.symbol if quantity.shared else f"{quantity.symbol}_i"
        (row,) = (line for line in PAGE.splitlines() if line.startswith("|") and f"`{name}`" in line)
        number = re.sub(",", "", row.split("|")[-3])
        assert float(number) == quantity.median(None, 0.0)  # type: ignore[arg-type]  # these look at no axle
