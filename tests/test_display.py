"""Constants and units that everything shown shares."""

import pytest
from scipy import stats

from sysid.display import Z90, shown_unit


def test_the_deviate_holds_ninety_percent_of_a_normal_distribution():
    assert stats.norm.cdf(Z90) - stats.norm.cdf(-Z90) == pytest.approx(0.90, rel=1e-14)


@pytest.mark.parametrize("unit", ["m", "N", "N/m", "N s/m", "N*s/m", "m/s^2", "m/s", "1", ""])
def test_a_factor_is_that_of_the_prefix(unit: str):
    factor, shown = shown_unit(unit)
    plain = shown.replace("\u00b2", "^2").replace("N s", "N*s")
    prefix = plain.removesuffix(unit.replace("N s", "N*s"))
    assert factor == {"": 1.0, "k": 1e-3, "m": 1e3}[prefix]
