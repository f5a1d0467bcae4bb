"""Figures of bridges show the numbers of the results."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bridge_results import loads, over

from sysid import plot
from sysid.report.bridge_figures import bridge_figure, shown_effects, write_bridge_figures


def test_influence_line_and_its_axles():
    """A triangle of L / 4, a parabola of 100 mm per MN, and an arrow for every axle on the bridge."""
    one = loads()
    ax = plot.influence_line(one, one.effects[0], [0.0, 4.0, 14.0])
    assert max(ax.lines[0].get_ydata()) == pytest.approx(5.0)
    assert [t.get_text() for t in ax.texts if t.get_text()] == ["1", "2"]  # the third is not yet on the bridge
    deflection = plot.influence_line(one, one.effects[1], [0.0])
    assert max(deflection.lines[0].get_ydata()) == pytest.approx(100.0)
    assert "mm per MN" in deflection.get_ylabel()


def test_history_in_shown_units():
    ax = plot.effect_history(loads(), loads().effects[0])
    dynamic = next(line for line in ax.lines if line.get_label() == "dynamic")
    assert max(dynamic.get_ydata()) == pytest.approx(300.0)
    assert ax.get_ylabel() == "kN m"
    assert ax.get_title(loc="left") == "moment at 10 m: amplification 1.200"


def test_amplification_against_speed():
    ax = plot.amplification_against_speed([over(20.0, loads(1.3)), over(10.0, loads(1.1))])
    curve = next(line for line in ax.lines if line.get_label() == "moment at 10 m")
    assert np.allclose(curve.get_xdata(), [36.0, 72.0])
    assert np.allclose(curve.get_ydata(), [1.1, 1.3])
    one = plot.amplification_against_speed([over(20.0, loads())], shown={"deflection at 10 m"})
    assert [t.get_text() for t in one.get_legend().get_texts()] == ["deflection at 10 m"]


def test_the_least_value_is_called_so():
    """Beside a larger one of the other sense the number in a title would be read as its."""
    least = replace(loads().effects[0], sense="least")
    ax = plot.effect_history(loads(), least)
    assert ax.get_title(loc="left") == "moment at 10 m, least: amplification 1.200"


def test_files_of_passes(tmp_path):
    passes = [over(20.0, loads(1.3)), over(10.0, loads(1.1))]
    written = write_bridge_figures(passes, [0.0, 4.0, 14.0], tmp_path, "load_effects")
    assert [p.name for p in written] == ["load_effects_worst.svg", "load_effects_amplification.svg"]
    assert all("<svg" in p.read_text(encoding="utf-8")[:400] for p in written)
    assert write_bridge_figures([], [0.0], tmp_path, "load_effects") == ()
    one = write_bridge_figures(passes[:1], [0.0, 4.0, 14.0], tmp_path, "load_effects")
    assert [p.name for p in one] == ["laden_72kmh_bridge_river_effects.svg"]


def test_each_effect_is_shown_at_its_worst_speed():
    """The moment is larger in the fast pass; with 200 kN m there it would be shown in the slow one."""
    fast, slow = over(20.0, loads(1.3)), over(10.0, loads(1.1))
    shown = shown_effects([slow, fast])
    assert [e.name for _, e in shown] == ["moment at 10 m", "deflection at 10 m"]
    assert shown[0][0] is fast
    ax = bridge_figure([slow, fast], [0.0, 4.0, 14.0])
    assert ax.get_title(loc="left") == "moment at 10 m, at 72\N{NO-BREAK SPACE}km/h"
    first = loads(1.3).effects[0]
    weak = replace(loads(1.3), effects=(replace(first, dynamic=first.dynamic.times(-0.1)),))
    assert shown_effects([slow, over(20.0, weak)])[0][0] is slow
