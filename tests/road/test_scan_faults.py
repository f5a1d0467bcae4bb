"""Clouds that are no scan of a speed bump end in one sentence that says what to do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from synthetic_cloud import cloud, parabola, scan_of

from sysid.campaign.records import Scan
from sysid.errors import DataRejectedError
from sysid.road import ScanOptions, analyse_scan

RNG_SEED = 11


def noise_box(scale: tuple[float, float, float]) -> np.ndarray:
    return np.random.default_rng(RNG_SEED).random((4000, 3)) * scale


FAULTS: list[tuple[str, Callable[[], np.ndarray], float, str]] = [
    ("few points", lambda: cloud(parabola, points=50), 30, "50 points"),
    ("none", lambda: np.zeros((0, 3)), 30, "0 points"),
    ("all missing", lambda: np.full((500, 3), np.nan), 30, "0 points"),
    ("two columns", lambda: np.zeros((500, 2)), 30, "columns x, y and z"),
    ("one place", lambda: np.ones((500, 3)), 30, "has 1 points"),
    ("flat road", lambda: cloud(lambda s: 0 * s), 30, "no bump"),
    ("low bump", lambda: cloud(lambda s: parabola(s, 0.006)), 30, "no bump"),
    ("mm as m", lambda: 1000 * cloud(parabola), 30, "looks like mm"),
    ("cm as m", lambda: 100 * cloud(parabola), 30, "looks like cm"),
    ("m as mm", lambda: cloud(parabola) / 1000, 30, "check its unit"),
    ("z ten times too large", lambda: cloud(parabola, grade=0, camber=0) * [1, 1, 10], 30, "bump of 0.8"),
    ("upside down", lambda: cloud(parabola) * [1, 1, -1], 30, "z must point up"),
    ("y and z swapped", lambda: cloud(parabola, width=60, length=60, grade=0.1)[:, [0, 2, 1]], 30, "z must point up"),
    ("heading across", lambda: cloud(parabola), 120, "90 degrees off the perpendicular"),
    ("heading 45 degrees off", lambda: cloud(parabola), 75, "45 degrees off the perpendicular"),
    ("cut off", lambda: cloud(parabola, centre=2.3), 30, "cut off"),
    ("single line", lambda: cloud(parabola, width=0.01), 30, "one line"),
    ("noise", lambda: noise_box((5, 5, 5)), 30, "Scan cloud.csv"),
    ("thin noise", lambda: noise_box((5, 5, 0.1)), 30, "Scan cloud.csv"),
    ("round heap", lambda: heap(), 30, "no ridge"),
    ("person in the picture", lambda: np.concatenate([cloud(parabola), person()]), 30, "crop the cloud"),
]


def heap() -> np.ndarray:
    points = cloud(lambda s: 0 * s, grade=0, camber=0, offset=(0, 0, 0))
    points[:, 2] += 0.1 * np.exp(-np.sum(points[:, :2] ** 2, axis=1) / 0.3**2)
    return points


def person() -> np.ndarray:
    return np.array([12.0, -7.5, 1.6]) + np.random.default_rng(RNG_SEED).random((500, 3)) * [0.4, 0.4, 1.6]


@pytest.mark.parametrize(("make", "heading", "words"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS])
def test_fault_ends_in_one_sentence(make: Callable[[], np.ndarray], heading: float, words: str) -> None:
    with pytest.raises(DataRejectedError) as caught:
        analyse_scan(scan_of(make(), heading))
    text = str(caught.value)
    assert words in text
    assert text.startswith("Scan cloud.csv")
    assert text.endswith(".")
    assert "\n" not in text


def test_heading_is_suggested() -> None:
    with pytest.raises(DataRejectedError, match=r"heading_deg = 120\.0; expected is the direction of travel, (30|210)"):
        analyse_scan(scan_of(cloud(parabola), 120.0))


def test_heading_that_is_no_number() -> None:
    with pytest.raises(DataRejectedError, match="heading_deg"):
        analyse_scan(Scan("bump", "cloud.csv", float("nan"), cloud(parabola)))


def test_strip_outside_the_scan() -> None:
    with pytest.raises(DataRejectedError, match="widen the strip"):
        analyse_scan(scan_of(cloud(parabola)), options=ScanOptions(track_width_m=9.0))


def test_feet_read_as_metres_are_reported() -> None:
    analysis = analyse_scan(scan_of(cloud(parabola) / 0.3048))
    assert any("unusual for a speed bump" in text for text in analysis.messages)


def test_missing_rows_are_ignored() -> None:
    points = cloud(parabola)
    holed = np.concatenate([points, np.full((100, 3), np.nan)])
    assert analyse_scan(scan_of(holed)).points == points.shape[0]
