"""Continuous beams: influence lines and frequencies against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.bridge.beam import ContinuousBeam
from sysid.bridge.structure import Bridge

EI, MASS = 4.0e10, 9000.0


def beam(spans: list[float], supports: list[str] | None = None, sections: list[float] | None = None, modes: int = 6):
    supports = supports or ["pinned"] * (len(spans) + 1)
    count = len(spans)
    made = ContinuousBeam(spans, [EI] * count, [MASS] * count, supports)
    return made.bridge("beam", sections if sections is not None else [0.5 * spans[0]], modes, 0.0)


def line(bridge: Bridge, word: str):
    return next(one.curve for one in bridge.lines if one.name.startswith(word))


@pytest.mark.parametrize("x", [3.0, 10.0, 17.5])
def test_influence_lines_of_a_simple_beam(x: float):
    length = 20.0
    bridge = beam([length], sections=[x])
    s = np.array([0.0, 1.3, x - 1e-9, x + 1e-9, 0.9 * length, length, length + 1.0, -1.0])
    on = (s >= 0) & (s <= length)
    moment = np.where(on, np.where(s < x, s * (length - x), x * (length - s)) / length, 0.0)
    shear = np.where(on, np.where(s < x, -s, length - s) / length, 0.0)
    a, b = np.minimum(s, x), length - np.maximum(s, x)
    deflection = np.where(on, a * b * (length**2 - a**2 - b**2) / (6 * length * EI), 0.0)
    assert line(bridge, "moment").at(s) == pytest.approx(moment, abs=1e-7)
    assert line(bridge, "shear").at(s) == pytest.approx(shear, abs=1e-7)
    assert line(bridge, "deflection").at(s) == pytest.approx(deflection, rel=1e-7, abs=1e-18)


def test_influence_lines_of_two_equal_spans():
    """Moment over the middle support -a (L^2 - a^2) / (4 L^2), and the reactions that follow from it."""
    length = 24.0
    bridge = beam([length, length], sections=[0.0, length, 2 * length])
    a = np.array([0.0, 5.0, 14.0, 23.0])
    over = -a * (length**2 - a**2) / (4 * length**2)
    assert line(bridge, "moment at 24").at(a) == pytest.approx(over, abs=1e-9)
    assert line(bridge, "moment at 24").at(2 * length - a) == pytest.approx(over, abs=1e-9)
    assert line(bridge, "shear at 0").at(a) == pytest.approx((length - a) / length + over / length, abs=1e-9)
    assert line(bridge, "shear left").at(a) == pytest.approx(-a / length + over / length, abs=1e-9)
    assert line(bridge, "shear right").at(a) == pytest.approx(-over / length, abs=1e-9)
    assert line(bridge, "shear at 48").at(2 * length - a[1:]) == pytest.approx(
        -(length - a[1:]) / length - over[1:] / length, abs=1e-9
    )


def test_influence_lines_of_a_cantilever():
    bridge = beam([12.0], ["fixed", "free"], sections=[0.0, 12.0])
    s = np.array([0.0, 4.0, 12.0])
    assert line(bridge, "moment at 0").at(s) == pytest.approx(-s, abs=1e-6)
    assert line(bridge, "shear at 0").at(s) == pytest.approx(np.ones(3), abs=1e-7)
    assert line(bridge, "deflection at 12").at(s) == pytest.approx(s**2 * (36.0 - s) / (6 * EI), rel=1e-8)


@pytest.mark.parametrize(
    ("spans", "supports", "roots"),
    [
        ([30.0], ["pinned", "pinned"], np.pi * np.arange(1, 7)),
        # cos b cosh b = 1, tan b = tanh b, cos b cosh b = -1 (R. D. Blevins, Formulas for Natural Frequency).
        ([30.0], ["fixed", "fixed"], [4.73004074, 7.85320462, 10.9956079, 14.1371655]),
        ([30.0], ["fixed", "pinned"], [3.92660231, 7.06858275, 10.2101761, 13.3517688]),
        ([30.0], ["fixed", "free"], [1.87510407, 4.69409113, 7.85475744, 10.9955407]),
        # Two spans: those of a pinned span and of a fixed and pinned one in turn.
        ([30.0, 30.0], ["pinned"] * 3, [np.pi, 3.92660231, 2 * np.pi, 7.06858275]),
    ],
)
def test_frequencies(spans, supports, roots):
    roots = np.array(roots)
    found = beam(spans, supports, modes=6).modes.frequency_hz[: roots.size]
    exact = roots**2 / (2 * np.pi * spans[0] ** 2) * np.sqrt(EI / MASS)
    assert found == pytest.approx(exact, rel=2e-5)
    assert found[:2] == pytest.approx(exact[:2], rel=1e-6)
    assert found != pytest.approx(exact * 1.001, rel=2e-5)


def test_effects_of_a_mode_are_those_of_its_curvature():
    """Moment EI (n pi / L)^2 and shear EI (n pi / L)^3 of w = sin(n pi x / L)."""
    length = 20.0
    bridge = beam([length], sections=[0.0, 7.0])
    modes, names = bridge.modes, [one.name for one in bridge.lines]
    n = np.arange(1, 7)
    size = modes.shape.at(np.array(7.0)) / np.sin(n * np.pi * 7.0 / length)
    assert np.abs(size) == pytest.approx(np.sqrt(2 / (MASS * length)), rel=1e-4)
    wave = n * np.pi / length
    moment = modes.effects[names.index("moment at 7 m")]
    shear = modes.effects[names.index("shear at 0 m")]
    assert moment == pytest.approx(EI * wave**2 * size * np.sin(wave * 7.0), rel=1e-3, abs=1e-3 * np.abs(moment).max())
    assert shear == pytest.approx(EI * wave**3 * size, rel=1e-3)


def test_a_section_beside_a_node_and_spans_of_their_own():
    """A section that almost falls on a node; stiffness and mass differ between spans, loads balance."""
    made = ContinuousBeam([20.0, 31.0], [EI, 3 * EI], [MASS, 2 * MASS], ["pinned", "pinned", "fixed"])
    bridge = made.bridge("beam", [10.0 + 1e-7, 20.0], 8, 0.01)
    s = np.array([3.0, 11.0])
    jump = line(bridge, "shear right").at(s) - line(bridge, "shear left").at(s)
    left = line(bridge, "shear left").at(s)
    # Moments about the middle support: M_B = V_B- L - (load's moment), all from the left span alone.
    assert line(bridge, "moment at 20").at(s) == pytest.approx(20.0 * (left + 1.0) - (20.0 - s), abs=1e-7)
    assert np.all(jump > 0.0)


def test_a_beam_that_falls_is_refused():
    with pytest.raises(ValueError, match="falls"):
        ContinuousBeam([10.0], [EI], [MASS], ["pinned", "free"])
    with pytest.raises(ValueError, match="every span"):
        ContinuousBeam([10.0], [EI, EI], [MASS], ["pinned", "pinned"])
    with pytest.raises(ValueError, match="ends"):
        ContinuousBeam([10.0, 10.0], [EI, EI], [MASS, MASS], ["pinned", "free", "pinned"])
