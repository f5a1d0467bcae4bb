"""The sentence about sensors on one side and a bump off square."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.bookkeeping.sides import one_sided_sentence
from sysid.campaign.records import Sensor


def said(side: Any, skew_deg: float) -> str | None:
    channels = [
        SimpleNamespace(sensor=Sensor("one", "axle_acceleration", "g", axle=0, side=side)),
        SimpleNamespace(sensor=Sensor("two", "axle_acceleration", "g", axle=1)),
    ]
    run = SimpleNamespace(bump="bump", log=SimpleNamespace(channels=channels))
    sides = SimpleNamespace(skew_rad=float(np.radians(skew_deg)))
    scan = SimpleNamespace(profile=SimpleNamespace(sides=sides))
    campaign: Any = SimpleNamespace(bump_runs=[run])
    scans: Any = {"bump": scan}
    return one_sided_sentence(campaign, scans)


@pytest.mark.parametrize("skew_deg", [2.2, -2.2])
def test_one_side_and_an_angle_together_are_named(skew_deg: float) -> None:
    sentence = said("right", skew_deg)
    assert sentence is not None
    assert "2.2 degrees off square, and axle 1 has sensors on one side only (right)" in sentence


def test_one_of_them_alone_is_not() -> None:
    assert said("right", 0.0) is None
    assert said(None, 2.2) is None
