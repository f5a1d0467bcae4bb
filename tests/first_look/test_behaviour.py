"""What columns do: threes of one axle, order and speed of a passage, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.first_look.column_words import columns_say
from sysid.first_look.features import looks, threes
from sysid.first_look.matching import Three, matched_threes, upright
from sysid.first_look.places import (
    Passage,
    arrival_order,
    axles_of_ranks,
    counted_from_one,
    in_order,
    measured_positions,
    numbered_axles,
    speed_m_s,
)
from sysid.first_look.words import AxleLabel
from sysid.logs.channels import Clock, RawChannel

STEP_S = 0.005
G = 9.80665


def ring(hz: float, decay: float, start_s: float, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A motion that begins smoothly, t^3 exp(-d t) sin(w t), and its second derivative by finite differences of fine
    steps: independent of any transform."""
    fine = np.arange(time[0] - 1e-3, time[-1] + 1e-3, 1e-4)
    after = np.clip(fine - start_s, 0.0, None)
    value = after**3 * np.exp(-decay * after) * np.sin(2.0 * np.pi * hz * after)
    second = np.gradient(np.gradient(value, fine), fine)
    return np.interp(time, fine, value), np.interp(time, fine, second)


def axle(start_s: float, hop_hz: float) -> dict[str, np.ndarray]:
    """Deflection [mm], axle and frame acceleration [g] of one axle: body at 1.6 Hz, wheel hop above."""
    time = STEP_S * np.arange(1200)
    body, of_body = ring(1.6, 2.0, start_s, time)
    hop, of_hop = ring(hop_hz, 8.0, start_s, time)
    return {"q": 1e3 * (body - 0.6 * hop), "a": 0.6 * of_hop / G, "b": of_body / G}


def channels(columns: dict[str, np.ndarray], noise: float = 1e-3) -> list[RawChannel]:
    clock = Clock("time_s", STEP_S * np.arange(1200))
    rng = np.random.default_rng(3)
    return [
        RawChannel(name, clock, values + noise * np.ptp(values) * rng.normal(size=values.size))
        for name, values in columns.items()
    ]


def found_in(columns: dict[str, np.ndarray], dimension: dict[str, str] | None = None, noise: float = 1e-3):
    of_log = channels(columns, noise)
    seen = looks(of_log)
    fit = threes(of_log, seen)
    assert fit is not None
    return matched_threes([fit], {look.name: look.hop_share for look in seen}, dimension or {})


def test_columns_of_two_axles_are_told_apart_by_the_equation_alone() -> None:
    # The noise of the other tests makes factors of the axle scatter by 3.5 % (200 seeds), a tenth of it by 0.4 %.
    one, two = axle(1.0, 6.0), axle(1.4, 7.0)
    found = found_in(
        {"u": one["b"], "v": two["q"], "w": one["q"], "x": two["a"], "y": one["a"], "z": two["b"]}, noise=1e-4
    )
    assert {(t.deflection, t.axle, t.body) for t in found} == {("w", "y", "u"), ("v", "x", "z")}
    for three in found:
        # q in mm and accelerations in g: 1 g is 9806.65 mm/s2.
        assert three.alpha == pytest.approx(9806.65, rel=0.015)
        assert three.beta == pytest.approx(9806.65, rel=0.015)


@pytest.mark.parametrize(("turned", "signs"), [("a", (-1, 1)), ("b", (1, -1)), ("q", (-1, -1))])
def test_signs_tell_which_column_is_upside_down(turned: str, signs: tuple[int, int]) -> None:
    columns = axle(1.0, 10.0)
    columns[turned] = -columns[turned]
    (three,) = found_in(columns)
    assert (np.sign(three.alpha), np.sign(three.beta)) == signs


def test_a_deflection_upside_down_is_none_where_names_exchange_frame_and_axle() -> None:
    (three,) = found_in(axle(1.0, 10.0))
    kinds = {"a": "axle_acceleration", "b": "body_acceleration"}
    assert upright(three, kinds) == three
    # The same equation, read with the roles exchanged: by the names nothing is upside down.
    read = Three("q", "b", "a", three.unexplained, -three.beta, -three.alpha)
    assert upright(read, kinds) == three
    assert upright(read, {}) == read


def test_without_a_frame_sensor_pairs_are_found() -> None:
    one, two = axle(1.0, 9.0), axle(1.4, 11.0)
    found = found_in({"u": two["a"], "v": one["q"], "w": one["a"], "x": two["q"]})
    assert {(t.deflection, t.axle, t.body) for t in found} == {("v", "w", None), ("x", "u", None)}


def test_a_unit_that_is_said_stands_against_a_weak_match() -> None:
    one = axle(1.0, 9.0)
    # Something else shakes the deflection sensor.
    one["q"] = one["q"] + 1500.0 * ring(4.0, 4.0, 1.2, STEP_S * np.arange(1200))[0]
    assert len(found_in(dict(one))) == 1
    assert found_in(dict(one), {"q": "acceleration"}) == ()


def test_noise_belongs_to_nobody() -> None:
    rng = np.random.default_rng(2)
    step = (np.arange(1200) > 300).astype(float)
    assert found_in({name: 20.0 * step * rng.normal(size=1200) for name in "abcdef"}) == ()


POSITIONS_M = (0.0, 4.2, 5.55, 12.0)


def passage(speed: float, start_s: float = 0.8, skip: tuple[int, ...] = ()) -> Passage:
    return Passage("run", {f"c{i}": start_s + x / speed for i, x in enumerate(POSITIONS_M) if i not in skip})


def test_columns_come_in_the_order_of_their_axles() -> None:
    order = arrival_order([passage(3.0), passage(6.0, 1.1)])
    assert dict(order.rank) == {"c0": 0, "c1": 1, "c2": 2, "c3": 3}
    np.testing.assert_allclose(order.share, np.array(POSITIONS_M) / POSITIONS_M[-1], atol=1e-12)
    both_sides = Passage("run", {**passage(3.0).arrival_s, "c1 other side": 0.8 + 4.25 / 3.0})
    assert arrival_order([both_sides]).rank["c1 other side"] == 1


def test_speed_and_positions_follow_from_arrivals() -> None:
    times = dict(enumerate(passage(5.0).arrival_s.values()))
    assert speed_m_s(times, POSITIONS_M) == pytest.approx(5.0, rel=1e-12)
    assert speed_m_s({0: 1.0, 1: 0.5, 2: 2.0, 3: 1.2}, POSITIONS_M) is None
    found = measured_positions([(times, 5.0), (dict(enumerate(passage(2.0).arrival_s.values())), 2.0)], 4)
    np.testing.assert_allclose(found, POSITIONS_M, atol=1e-12)
    assert measured_positions([({0: 1.0, 1: 2.0}, 5.0)], 3) is None


def test_axles_without_a_sensor_are_found_by_the_delays() -> None:
    share = arrival_order([passage(4.0, skip=(1,))]).share
    assert axles_of_ranks(share, POSITIONS_M) == (0, 2, 3)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["axle1_acc", "axle2_acc", "axle3_acc"], [0, 1, 2]),
        (["axle0_acc", "axle1_acc"], [0, 1]),
        (["steer_acc", "drive1_acc", "drive2_acc", "trailer1_acc", "trailer2_acc"], [0, 1, 2, 3, 4]),
        (["Beschl. Achse vorne", "Beschl. Achse hinten"], [0, 1]),
        (["ch1", "ch2"], []),
        (["WegVA", "WegHA1", "WegHA2"], [0, 1, 2]),
        (["VA1 acc", "VA2 acc", "HA3 acc", "HA4 acc"], [0, 1, 2, 3]),
        # Of rear axles alone nobody knows how many stand before them.
        (["HA1 acc", "HA2 acc"], []),
    ],
)
def test_names_count_axles_as_people_do(names: list[str], expected: list[int]) -> None:
    from_one = counted_from_one(said.axle for said in columns_say(names).values())
    axles = numbered_axles(from_one.values())
    assert [axles[label] for said in columns_say(names).values() if (label := from_one[said.axle]) in axles] == expected


def test_names_against_the_order_of_arrival() -> None:
    named = {"a": 0, "b": 1}
    assert in_order(named, {"a": 0, "b": 1})
    assert not in_order(named, {"a": 1, "b": 0})


def test_columns_may_count_axles_from_zero_and_paths_from_one() -> None:
    columns, paths = ([AxleLabel(n) for n in numbers] for numbers in ((0, 1, 2), (1, 2, 3)))
    assert set(counted_from_one(columns).values()) == set(counted_from_one(paths).values()) == set(paths)
    assert numbered_axles(paths) == {AxleLabel(1): 0, AxleLabel(2): 1, AxleLabel(3): 2}


def test_an_axle_that_names_leave_open_is_left_out() -> None:
    front, rear, drive, tag = (AxleLabel(place=p) for p in ("front", "rear", "drive", "tag"))
    assert numbered_axles([front, rear]) == numbered_axles([front, rear], 2) == {front: 0, rear: 1}
    # Of three axles that arrive one has no name: the rear one is not the second.
    assert numbered_axles([front, rear], 3) == {front: 0}
    middle = AxleLabel(place="middle")
    assert numbered_axles([front, middle, rear], 3) == {front: 0, middle: 1, rear: 2}
    # Two axles stand at the rear: which of them?
    assert numbered_axles([front, drive, tag, rear]) == {front: 0, drive: 1, tag: 2}
    first, second = AxleLabel(1, "rear"), AxleLabel(2, "rear")
    assert numbered_axles([front, first, second, rear]) == {front: 0, first: 1, second: 2}
    one, two, three = (AxleLabel(n) for n in (1, 2, 3))
    # Two ways to call all axles, if they are equally many.
    assert numbered_axles([one, two, front, rear]) == {one: 0, two: 1, front: 0, rear: 1}
    assert numbered_axles([one, two, three, front, rear]) == {one: 0, two: 1, three: 2, front: 0}
