"""Figures of a fleet: what is drawn of few trucks and of many."""

from __future__ import annotations

import numpy as np

from sysid import plot


def trucks(count: int, parameters: int = 2) -> np.ndarray:
    """5 %, 50 % and 95 % of every truck (3, count, parameters)."""
    middle = np.exp(0.1 * np.random.default_rng(0).standard_normal((count, parameters)))
    return np.stack([0.95 * middle, middle, 1.05 * middle])


def test_few_trucks_are_named_and_many_only_where_they_stand_out() -> None:
    for count, named in ((5, 5), (100, 1)):
        values = trucks(count)
        ax = plot.truck_map(
            4e5 * values[:, :, 0], 1e4 * values[:, :, 1], [f"T{t}" for t in range(count)], {3},
            (np.array([3e5, 5e5]), np.array([8e3, 1.2e4])), 1,
        )  # fmt: skip
        assert len(ax.texts) == named
        assert "T3" in [t.get_text() for t in ax.texts]
        assert ax.get_xlabel() == "stiffness k [kN/m]"
        # The marks stand where the medians are, in the units of the axes.
        marks = ax.collections[-1].get_offsets()
        assert np.allclose(marks, np.column_stack([400.0 * values[1, :, 0], 10.0 * values[1, :, 1]]))


def test_shrinkage_shows_the_trucks_furthest_out() -> None:
    values = trucks(100)
    values[:, 60, 1] *= 0.4
    alone = values.copy()
    alone[:, 7, 0] = np.nan
    grid = plot.shrinkage(alone, values, np.ones(2), [f"T{t}" for t in range(100)], ("k_1", "c_1"), {(60, 1)})
    rows = [t.get_text() for t in grid[0, 0].get_yticklabels()]
    assert len(rows) == plot.FLEET_ROWS
    assert "T60" in rows
    few = plot.shrinkage(trucks(4), trucks(4), np.ones(2), list("ABCD"), ("k_1", "c_1"))
    assert [t.get_text() for t in few[0, 0].get_yticklabels()] == list("ABCD")


def test_loads_are_drawn_row_by_row() -> None:
    ax = plot.population_loads(
        ["empty, axle 1", "empty, axle 2"], [0, 1], np.array([[1.1, 1.2], [1.3, 1.4], [1.5, 1.6]])
    )
    assert np.allclose(ax.collections[-1].get_offsets(), [[1.3, 0.0], [1.4, 1.0]])
