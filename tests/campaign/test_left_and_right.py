"""Sensors on both sides of one place that differ: what is said, by cause, and that roll is no wrong sign."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.campaign.inputs.log_sides import join_sides
from sysid.campaign.records import Channel, Sensor

TIME = 0.005 * np.arange(1000)
SINCE = np.maximum(TIME - 1.5, 0.0)


def moved(time: np.ndarray) -> np.ndarray:
    """An axle on a bump: hop at 11 Hz and the body at 2 Hz."""
    since = np.maximum(time - 1.5, 0.0)
    return 30.0 * np.exp(-6.0 * since) * np.sin(69.0 * since) + 3.0 * np.exp(-1.5 * since) * np.sin(12.6 * since)


def said(right: np.ndarray, censored: np.ndarray | None = None) -> list[str]:
    """Messages about a left sensor with the motion above, and a right one."""
    none = np.zeros(TIME.size, np.int8)
    pair = [
        Channel(Sensor(side, "axle_acceleration", "m/s^2", axle=0, side=side), TIME, value, marks)
        for side, value, marks in (
            ("left", moved(TIME), none),
            ("right", right, none if censored is None else censored),
        )
    ]
    messages: list[str] = []
    join_sides(pair, "run.csv", messages)
    return messages


CAUSES = {
    "check the sign": -moved(TIME),
    "reads 9.81 times the first: check unit": 9.80665 * moved(TIME),
    "they move differently, as where the truck rolls": 6.0 * np.exp(-1.5 * SINCE) * np.sin(7.0 * SINCE),
    "the truck rolls, or one of them is mounted elsewhere": 1.88 * moved(TIME),
}


@pytest.mark.parametrize(("words", "right"), CAUSES.items(), ids=CAUSES)
def test_the_cause_is_named(words: str, right: np.ndarray) -> None:
    (sentence,) = said(right)
    assert words in sentence
    assert ("sign" in sentence) == (words == "check the sign")


def test_what_an_angle_and_tramp_make_different_is_no_fault() -> None:
    """Twenty sentences about healthy sensors hid the one about a wrong one."""
    tramp = 12.0 * np.exp(-6.0 * SINCE) * np.sin(75.0 * SINCE)
    assert said(moved(TIME - 0.04)) == []
    assert said(moved(TIME - 0.04) + tramp) == []
    noise = np.random.default_rng(3).normal(0.0, 3.0, TIME.size)
    assert said(moved(TIME) + noise) == []
    # The same sides with one sign turned are named.
    assert "check the sign" in said(-(moved(TIME - 0.04) + tramp))[0]


@pytest.mark.parametrize(("roll_m_s2", "sentences"), [(0.4, 0), (4.0, 1)])
def test_roll_that_is_little_beside_the_hop_is_not_worth_a_word(roll_m_s2: float, sentences: int) -> None:
    """Of an axle that hops, heave below 3 Hz is so little that any roll is as large."""
    assert len(said(moved(TIME) + roll_m_s2 * np.sin(5.6 * TIME))) == sentences


def test_clipped_readings_and_gaps_of_one_side_are_not_compared() -> None:
    motion = moved(TIME)
    clipped = np.clip(np.round(motion, 2), -8.0, 8.0)
    (sentence,) = said(clipped)
    assert "'right' is clipped at 8 m/s^2" in sentence
    assert said(clipped, np.sign(motion - clipped).astype(np.int8)) == []
    gap = np.where((SINCE > 0.02) & (SINCE < 0.4), np.nan, motion)
    assert said(gap) == []
    assert said(1.3 * motion) == []
