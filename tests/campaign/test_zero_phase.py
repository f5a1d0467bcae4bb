"""Filters without delay against those of SciPy, which run forward and backward in time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from sysid.campaign.zero_phase import band_passed, low_passed

COUNT = 3000
READINGS = np.random.default_rng(4).standard_normal(COUNT) + 5.0 * np.sin(np.arange(COUNT) / 40.0)
AWAY_FROM_ENDS = slice(COUNT // 4, -COUNT // 4)


@pytest.mark.parametrize("order", [2, 3])
def test_low_pass_is_that_of_scipy(order: int) -> None:
    found = low_passed(READINGS, order, 0.03)[AWAY_FROM_ENDS]
    expected, other = (
        sosfiltfilt(butter(order, edge, output="sos"), READINGS)[AWAY_FROM_ENDS] for edge in (0.03, 0.0301)
    )
    assert found == pytest.approx(expected, abs=1e-10)
    assert found != pytest.approx(other, abs=1e-4)


def test_band_pass_is_that_of_scipy() -> None:
    found = band_passed(READINGS, 3, 0.25, 0.7)[AWAY_FROM_ENDS]
    expected, other = (
        sosfiltfilt(butter(3, band, "bandpass", output="sos"), READINGS)[AWAY_FROM_ENDS]
        for band in ((0.25, 0.7), (0.25, 0.701))
    )
    assert found == pytest.approx(expected, abs=1e-10)
    assert found != pytest.approx(other, abs=1e-4)


def test_a_line_stays_a_line_up_to_its_ends() -> None:
    line = np.linspace(-3.0, 8.0, 801)
    assert low_passed(line, 2, 0.05) == pytest.approx(line, abs=1e-3)
    assert band_passed(line, 3, 0.25, 0.7) == pytest.approx(np.zeros(801), abs=1e-3)
    # A record that ends in a step is no such line.
    line[-1] = 0.0
    assert low_passed(line, 2, 0.05) != pytest.approx(line, abs=1e-3)
