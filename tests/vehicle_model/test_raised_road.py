"""Heights beside a road's own: where they are, and that the road is as long as they are."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.vehicle_model.contact import RoadRise, effective_road, raised_along, road_input


def test_the_road_has_further_heights_where_they_are_and_is_itself_elsewhere() -> None:
    station = np.arange(-0.5, 1.5, 0.01)
    own = 0.05 * np.exp(-(((station - 0.5) / 0.2) ** 2))
    road = effective_road(station, np.tile(own, (2, 1, 1)))
    further = np.arange(0.3, 4.0, 0.01)
    height = np.stack([0.01 * np.sin(np.pi * (further - 0.3) / 3.69) ** 2, 0.0 * further])[:, None]
    raised = raised_along(road, RoadRise(further, height))
    assert raised.station_m[0] == pytest.approx(station[0])
    # Less than a hundredth of a millimetre is left out.
    assert 3.9 < raised.station_m[-1] < further[-1]
    at = np.array([-0.2, 0.25, 0.5, 1.0, 2.1, 3.5])
    found = np.asarray(road_input(raised, np.tile(at, (2, 1, 1))).rise)
    true = 0.05 * np.exp(-(((at - 0.5) / 0.2) ** 2)) * (at < 1.5)
    more = np.where(at > 0.3, 0.01 * np.sin(np.pi * (at - 0.3) / 3.69) ** 2, 0.0)
    np.testing.assert_allclose(found[0, 0], true + more, atol=2e-6)
    np.testing.assert_allclose(found[1, 0], true, atol=2e-6)
