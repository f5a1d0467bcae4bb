"""The study of ring-downs: its own physics against closed forms, its table, and what it must show."""

from __future__ import annotations

import numpy as np
import pytest

from studies.ring_downs.motion import KINDS, Oscillator, draw, ring
from studies.ring_downs.reading import replicate
from studies.ring_downs.table import errors, held, right, table, write

TIME = np.arange(0.0, 4.0, 0.005)
DEVELOPMENT_SEED = 11


def test_viscous_ring_is_the_closed_form():
    o = Oscillator(3000.0, 4e5, 9e3)
    beta, omega = 1.5, 2.0 * np.pi / o.damped_period
    expected = 0.05 * np.exp(-beta * TIME) * (np.cos(omega * TIME) + beta / omega * np.sin(omega * TIME))
    np.testing.assert_allclose(ring(o, 0.05, TIME)[0], expected, atol=1e-8)


def test_friction_takes_the_same_from_every_swing_until_it_holds():
    o = Oscillator(3000.0, 4e5, friction=1100.0)
    turns = np.abs(ring(o, 0.05, TIME)[1])
    np.testing.assert_allclose(-np.diff(turns), 2.0 * 1100.0 / 4e5, rtol=1e-6)
    assert turns[-1] < 1100.0 / 4e5 < turns[-2]


def test_quadratic_damping_keeps_the_integral_of_motion():
    """d(v^2)/dx - 2 q v^2 = -2 omega^2 x on a downward swing (v < 0): an integral that both its ends share."""
    o = Oscillator(3000.0, 4e5, quadratic=2.4e4)
    q, omega2 = 8.0, 4e5 / 3000.0
    turns = ring(o, 0.05, TIME)[1]

    def integral(x):
        # exp(-2 q x) (x / (2 q) + 1 / (4 q^2)) is what a downward swing keeps at both its ends.
        return np.exp(-2.0 * q * x) * (x / (2.0 * q) + 1.0 / (4.0 * q**2)) * 2.0 * omega2

    assert integral(turns[0]) == pytest.approx(integral(turns[1]), rel=1e-8)


@pytest.mark.parametrize("number", [0, 1, 9, 10, 18, 19, 34])
def test_kinds_of_some_ring_downs(number):
    """Development seed; one ring-down of every kind."""
    record, found = draw(DEVELOPMENT_SEED, number), replicate(number, DEVELOPMENT_SEED)
    assert found["kind"] == " + ".join(record.kind) == " + ".join(KINDS[number % 7])
    if found["visible"]:
        assert found["found"] == found["kind"]
        assert abs(errors([found], "period")[0][0]) < 0.003


def example(kind, found, value):
    quantities = {"period": (1.0, 1.0, 0.1), "k": (1.0, 1.0, 0.1), "c": (2.0, value, 0.1)}
    quantities |= {"F": (0.0, None, None), "Q": (0.0, None, None)}
    return {"number": 0, "kind": kind, "found": found, "visible": True, "quantities": quantities}


def test_table_counts_and_is_written(tmp_path):
    records = [example("viscous", "viscous", 2.1), example("viscous", "friction", 2.3)]
    assert right(records) == 1
    assert errors(records, "c") == [pytest.approx((0.05, 1.0)), pytest.approx((0.15, 3.0))]
    assert errors(records, "F") == []
    assert held(errors(records, "c")) == 0.5
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- ring-downs: begin -->\nlast week's\n<!-- ring-downs: end -->\nb\n", encoding="utf-8")
    write(records, 4, page)
    text = page.read_text(encoding="utf-8")
    assert table(records) in text
    assert "last week" not in text
    assert text.startswith("a\n")
    assert text.endswith("b\n")


@pytest.mark.long
def test_two_hundred_ring_downs():
    records = [r for r in map(replicate, range(200)) if r["visible"]]
    assert len(records) > 100
    assert right(records) >= 0.95 * len(records)
    limits = {"period": 0.003, "c": 0.15, "F": 0.20}
    for quantity, limit in limits.items():
        found = errors(records, quantity)
        assert np.quantile([abs(e) for e, _ in found], 0.95) < limit
    intervals = [z for q in ("period", "c", "F", "Q") for z in errors(records, q)]
    assert 0.85 <= held(intervals) <= 0.95
