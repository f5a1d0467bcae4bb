"""Roll in the readings of sensors on one side: its derivatives, and that means of both sides are free of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import SENSORS
from turned_bump import MOTION, RIGHT, made

from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.side_signals import side_signals, with_sides
from sysid.estimation.residuals.side_unknowns import KINDS, LEVER, SKEW, lever_m, side_unknowns
from sysid.estimation.uncertainty.allowances import campaign_allowances


def shown(model: BumpModel, x: np.ndarray, sides: Mapping[tuple, float] | None = None) -> np.ndarray:
    return side_signals(replace(model, sides=tuple((sides or {}).items())), 0, x, MOTION, ()).shown


def test_derivatives_are_differences_of_the_roll() -> None:
    data, model, x = made(RIGHT)
    unknowns = side_unknowns(data, model.felt)
    assert {u.kind for u in unknowns} == set(KINDS)
    found = side_signals(model, 0, x, MOTION, unknowns)
    base = shown(model, x)[:, :, found.channels]
    for k, u in enumerate(unknowns):
        step = 2e-3 * u.sd
        there = shown(model, x, {(u.kind, u.place, u.load_case, u.of): step})[:, :, found.channels]
        difference, column = (there - base) / step, found.columns[..., k]
        size = max(float(np.abs(difference).max()), 1e-9)
        assert np.abs(column - difference).max() < (0.03 if u.kind == SKEW else 0.02) * size, u.name
    # Every unknown has an effect of its own.
    flat = found.columns.reshape(-1, len(unknowns))
    alike = np.corrcoef(flat, rowvar=False) - np.eye(len(unknowns))
    assert np.all(np.abs(alike[~np.isnan(alike)]) < 0.9999)


def test_left_and_right_show_opposite_roll() -> None:
    _, model, x = made(RIGHT)
    other = replace(model, layout=type(model.layout)(tuple(replace(s, side="left") if s.side else s
                                                           for s in model.layout.sensors)))  # fmt: skip
    right, left = shown(model, x), shown(other, x)
    assert np.abs(right).max() > 1e-4
    np.testing.assert_allclose(left, -right, atol=1e-12)


def test_readings_are_cleared_of_roll_and_means_stay() -> None:
    data, model, x = made(RIGHT)
    cleared = with_sides(model, x, MOTION)
    # The roll about the mean motion over the raised road.
    np.testing.assert_allclose(model.groups[0].value - cleared.arrays[0].value, shown(cleared, x), atol=2e-5)
    assert np.abs(cleared.rises[0].height_m).max() > 1e-6
    of_means = [c for c, s in enumerate(model.layout.sensors) if s.side is None]
    assert not np.any(shown(model, x)[:, :, of_means])
    assert campaign_allowances(data, model.parameters, model.felt).masses.sides.sum() == len(
        side_unknowns(data, model.felt)
    )
    plain_data, plain, _ = made(SENSORS)
    assert with_sides(plain, x, MOTION) is plain
    assert side_unknowns(plain_data, plain.felt) == ()


def test_fewer_samples_of_fast_logs_show_the_same_roll() -> None:
    """The sampler keeps every second reading of fast logs, and their records keep all."""
    data, model, x = made(RIGHT)
    unknowns = side_unknowns(data, model.felt)[:2]
    (shape,) = model.shapes
    half, longer = -(-shape.samples // 2), 2.0 * shape.interval_s
    slow = shape._replace(samples=half, interval_s=longer, substeps=2 * shape.substeps)
    all_of, fewer = (side_signals(m, 0, x, MOTION, unknowns) for m in (model, replace(model, shapes=(slow,))))
    for every, kept in ((all_of.shown, fewer.shown), (all_of.columns, fewer.columns)):
        assert kept.shape[0] == slow.samples
        assert np.abs(kept - every[::2]).max() < 0.01 * np.abs(every).max()


@pytest.mark.parametrize(
    ("given", "metres"), [({"side": "left"}, 0.45), ({"side": "right", "y_m": -0.6}, -0.6), ({}, 0.0)]
)
def test_places_of_sensors(given: dict, metres: float) -> None:
    data, model, _ = made(RIGHT)
    assert lever_m(replace(SENSORS[0], **given), model.felt.vehicle) == pytest.approx(metres)
    sd = {u.of: u.sd for u in side_unknowns(data, model.felt) if u.kind == LEVER}
    assert set(sd.values()) == {0.15}
