"""Load models of codes on simple and continuous beams, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.bridge.beam import ContinuousBeam
from sysid.bridge.code_vehicles import LOAD_MODELS, AxleTrain, LoadModel, model_effect, train_effect


def simple(length: float, at: float | None = None):
    beam = ContinuousBeam([length], [4e10], [9e3], ["pinned", "pinned"])
    return beam.bridge("beam", [0.5 * length if at is None else at], 2, 0.0)


def line(bridge, word: str):
    return next(one for one in bridge.lines if one.name.startswith(word))


def model(name: str) -> LoadModel:
    return next(m for m in LOAD_MODELS if m.name == name)


def test_axles_of_m1600_on_thirty_metres():
    """5,250 kN m at mid-span from the twelve axles at their least gap, without allowance and lane (ospgrillage)."""
    bridge, axles = simple(30.0), model("M1600").combinations[0][0]
    found = train_effect(line(bridge, "moment"), [1e3 * p for p in axles.load_kN], axles.x_m, 30.0)
    assert found == pytest.approx(5250e3, rel=1e-4)
    wider = [x + 0.5 * (k > 5) for k, x in enumerate(axles.x_m)]
    assert train_effect(line(bridge, "moment"), [120e3] * 12, wider, 30.0) != pytest.approx(5250e3, rel=1e-4)


def test_trains_cross_in_either_direction():
    """At a quarter of the span M = (0.75 L) / 4 per newton: of 30 and 10 kN, 4 m apart, the heavy one stands there."""
    bridge = simple(20.0, 5.0)
    moment = line(bridge, "moment")
    exact = 30e3 * 3.75 + 10e3 * 3.75 * (15.0 - 4.0) / 15.0
    for load in ([30e3, 10e3], [10e3, 30e3]):
        assert train_effect(moment, load, [0.0, 4.0], 20.0) == pytest.approx(exact, rel=1e-9)
    # Equal loads at unequal distances too.
    both = [train_effect(moment, [1e3] * 3, x, 20.0) for x in ([0.0, 1.0, 6.0], [0.0, 5.0, 6.0])]
    assert both[0] == pytest.approx(both[1], rel=1e-9)


def test_load_model_1_at_mid_span():
    """Tandem 600 kN: L / 4 less half a spacing of 1.2 m over two; lane q L^2 / 8."""
    length = 20.0
    exact = 600.0 * (length / 4 - 1.2 / 4) + 27.0 * length**2 / 8
    bridge = simple(length)
    assert model_effect(bridge, line(bridge, "moment"), model("LM1")) == pytest.approx(1e3 * exact, rel=1e-6)
    assert model_effect(bridge, line(bridge, "moment"), model("LM1"), -1.0) == pytest.approx(0.0, abs=1e-3)


def test_hl93_at_mid_span_and_over_a_support():
    """One truck at mid-span, by hand; over the middle support of two spans two trucks are worse than one."""
    length = 20.0
    truck = 145 * 5.0 + (145 + 35) * (10.0 - 4.3) / 2
    exact = 1.33 * truck + 9.3 * length**2 / 8
    bridge = simple(length)
    assert model_effect(bridge, line(bridge, "moment"), model("HL-93")) == pytest.approx(1e3 * exact, rel=1e-5)
    two = ContinuousBeam([30.0, 30.0], [4e10] * 2, [9e3] * 2, ["pinned"] * 3).bridge("two", [30.0], 2, 0.0)
    over, single = line(two, "moment"), model("HL-93").combinations
    # The lane alone: -q L^2 / 8 over the support.
    lane = LoadModel("lane", "", ((AxleTrain((0.0,), (0.0,)), 9.3),))
    assert model_effect(two, over, lane, -1.0) == pytest.approx(-9.3e3 * 30.0**2 / 8, rel=1e-6)
    one = model_effect(two, over, LoadModel("one", "", single), -1.0)
    assert model_effect(two, over, model("HL-93"), -1.0) < 1.1 * one < 0.0


def test_cl625_and_hb_at_mid_span():
    """Of the Canadian truck axles 1 to 4 or all of it; of HB four axles of 450 kN around the middle."""
    length = 30.0
    bridge = simple(length)
    x = np.array([0.0, 3.6, 4.8, 11.4, 18.0])
    load = np.array([50.0, 125.0, 125.0, 175.0, 150.0])

    def moment(load_kN: np.ndarray, x_m: np.ndarray) -> float:
        place = np.arange(0.0, 60.0, 0.005)[:, None] - x_m
        on = (place > 0) & (place < length)
        return float((np.minimum(place, length - place) / 2 * load_kN * on).sum(axis=1).max())

    cl = max(
        1.25 * moment(load, x),
        1.25 * moment(load[:4], x[:4]),
        1.4 * 175.0 * length / 4,
        0.8 * moment(load, x) + 9.0 * length**2 / 8,
        1.25 * moment(load[1:], x[1:]),
    )
    assert model_effect(bridge, line(bridge, "moment"), model("CL-625")) == pytest.approx(1e3 * cl, rel=1e-3)
    hb = moment(np.full(4, 450.0), np.array([0.0, 1.8, 7.8, 9.6]))
    assert model_effect(bridge, line(bridge, "moment"), model("HB 45")) == pytest.approx(1e3 * hb, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "length_m", "moment_kN_m"),
    [
        # Tandem 600 (10 / 4 - 1.2 / 4) = 1320; 27 x 10^2 / 8 = 337.5.
        ("LM1", 10.0, 1657.5),
        # Tandem 1.33 (110 x 2.5 + 110 x 1.9) = 643.72; 9.3 x 10^2 / 8 = 116.25.
        ("HL-93", 10.0, 759.97),
        # Truck 1.33 (145 x 5 + 145 x 2.85 + 35 x 2.85) = 1646.54; 9.3 x 20^2 / 8 = 465.
        ("HL-93", 20.0, 2111.54),
        # Axles 1 to 3 with 30 %: 1.3 (50 x 0.7 + 125 x 2.5 + 125 x 1.9) = 760.5; with a lane 0.8 x 585 + 112.5 = 580.5.
        ("CL-625", 10.0, 760.5),
        # Three axles around the middle 120 (1.875 + 2.5 + 1.875) = 750; 6 x 10^2 / 8 = 75; both with 30 %.
        ("M1600", 10.0, 1072.5),
        # Two axles of 450 kN: 450 (2.5 + 1.6).
        ("HB 45", 10.0, 1845.0),
    ],
)
def test_moments_that_were_written_by_hand(name: str, length_m: float, moment_kN_m: float):
    """Moment at mid-span of a simple beam, the influence line being (L / 2 - |x|) / 2."""
    bridge = simple(length_m)
    found = model_effect(bridge, line(bridge, "moment"), model(name))
    assert found == pytest.approx(1e3 * moment_kN_m, rel=1e-6)
    longer = simple(1.001 * length_m)
    assert model_effect(longer, line(longer, "moment"), model(name)) != pytest.approx(1e3 * moment_kN_m, rel=1e-6)


def test_shear_beside_an_axle_at_the_end():
    """All of the tandem at a support: 300 (1 + (L - 1.2) / L) and q L / 2."""
    length = 20.0
    bridge = simple(length, 0.0)
    exact = 300.0 * (1.0 + (length - 1.2) / length) + 27.0 * length / 2
    assert model_effect(bridge, line(bridge, "shear"), model("LM1")) == pytest.approx(1e3 * exact, rel=1e-6)


def test_senses_are_two():
    bridge = simple(10.0)
    with pytest.raises(ValueError, match="sense"):
        model_effect(bridge, bridge.lines[0], LOAD_MODELS[0], 0.5)


def test_every_model_has_a_source_and_a_load():
    for one in LOAD_MODELS:
        assert len(one.source) > 20
        assert all(len(t.load_kN) == len(t.x_m) for t, _ in (*one.combinations, *one.hogging))
