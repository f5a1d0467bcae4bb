"""The study of plank drops: its own physics against closed forms, its table, and what it must show."""

from __future__ import annotations

import numpy as np
import pytest

from studies.plank_drops.motion import KINDS, PLANK_M, Fall, QuarterCar, deflection, draw
from studies.plank_drops.reading import replicate
from studies.plank_drops.table import errors, held, table, usable, write

TIME = np.arange(0.0, 5.0, 0.005)
DEVELOPMENT_SEED = 4906


def test_a_linear_car_rings_at_its_poles():
    m, mu, kt, ct, k, c = 3500.0, 600.0, 1.8e6, 2500.0, 6e5, 9e3
    y = deflection(QuarterCar(m, mu, kt, ct, k, c), Fall(0.5, 0.06, rolls=True), TIME)
    system = [
        [0, 1, 0, 0],
        [-k / m, -c / m, k / m, c / m],
        [0, 0, 0, 1],
        [k / mu, c / mu, -(k + kt) / mu, -(c + ct) / mu],
    ]
    poles = np.linalg.eigvals(np.array(system))
    late = TIME > 1.5
    modes = np.exp(poles * (TIME[late, None] - 1.5))
    weights = np.linalg.lstsq(modes, y[late].astype(complex), rcond=None)[0]
    assert np.abs(y[late]).max() > 0.01
    np.testing.assert_allclose((modes @ weights).real, y[late], atol=2e-6)
    assert y[TIME < 0.4] == pytest.approx(0.0, abs=1e-9)


def test_friction_takes_the_same_from_every_swing():
    """A light wheel: the amplitude falls by 2 F / (k (1 + k / kt)) per swing, by the energy between turning points."""
    k, kt, friction = 6e5, 1.8e6, 1500.0
    car = QuarterCar(3500.0, 5.0, kt, 0.0, k, 0.0, friction=friction, slip_m=2e-5)
    y = deflection(car, Fall(0.3, 0.3, rolls=False), TIME)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(y))) != 0) + 1
    large = turns[(TIME[turns] > 0.8) & (np.abs(y[turns]) > 0.012)]
    height = np.abs(y[large])
    np.testing.assert_allclose(-np.diff(height), 2.0 * friction / (k * (1.0 + k / kt)), rtol=0.1)


def test_the_road_falls_by_the_plank():
    for fall in (Fall(0.5, 0.1, rolls=True), Fall(0.5, 0.1, rolls=False)):
        times = np.linspace(0.45, 0.65, 4001)
        height, rate = np.array([fall(t) for t in times]).T
        assert (height[0], height[-1]) == (PLANK_M, 0.0)
        np.testing.assert_allclose(np.gradient(height, times)[1010:2990], rate[1010:2990], atol=2e-3)


def test_kinds_take_turns_and_declared_values_are_off():
    drawn = [draw(DEVELOPMENT_SEED, number) for number in range(8)]
    assert tuple(r.kind for r in drawn) == KINDS
    assert all(("friction" in r.kind) == (r.car.friction > 0.0) for r in drawn)
    assert all(0.0 < abs(r.declared[0] / r.car.mass - 1.0) < 0.1 for r in drawn)


def test_one_drop_is_read():
    found = replicate(0, DEVELOPMENT_SEED)
    assert found["kind"] == "linear"
    assert usable([found], "free_decay")
    assert all(abs(z) < 3.0 for q in (0, 1) for _, z in errors([found], "free_decay", q))


def example(kind, value, good=True):
    row = {"usable": good, "numbers": [value, 0.1, 2.0, 0.5], "note": ""}
    return {
        "number": 0,
        "kind": kind,
        "truth": [1.0, 2.0],
        "rows": dict.fromkeys(("free_decay", "corrected", "paper"), row),
    }


def test_table_counts_and_is_written(tmp_path):
    records = [example("linear", 1.05), example("linear", 1.3), example("friction", 9.0, good=False)]
    assert errors(records, "paper", 0) == [pytest.approx((0.05, 0.5)), pytest.approx((0.3, 3.0))]
    assert held(errors(records, "paper", 0)) == 0.5
    assert "| linear | 2 | 2 | 50 % | 100 % |" in table(records)
    assert "| all | 3 | 2 | 50 % | 100 % |" in table(records)
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- plank-drops: begin -->\nlast week's\n<!-- plank-drops: end -->\nb\n", encoding="utf-8")
    write(records, 4, page)
    text = page.read_text(encoding="utf-8")
    assert table(records) in text
    assert "last week" not in text
    assert text.startswith("a\n")
    assert text.endswith("b\n")


@pytest.mark.long
def test_a_hundred_drops():
    records = [replicate(number, DEVELOPMENT_SEED) for number in range(104)]
    without = [r for r in records if "friction" not in r["kind"]]
    assert len(usable(without, "free_decay")) >= 0.6 * len(without)
    for quantity in (0, 1):
        assert 0.82 <= held(errors(records, "free_decay", quantity)) <= 1.0
