"""Faults of cables, amplifiers and inputs: filters, hum, noise, offsets, boxes that lag behind."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfilt

from studies.check_faults.made import (
    Fault,
    Made,
    a_column,
    an_axle,
    change_columns,
    change_text,
    count_axles,
    of_axle,
)
from studies.faults.campaign_copy import CampaignCopy

_STEP_S = 0.005
_UNLIKE = "late|early|lag|times what|does not follow|drift|wander|noise|filter|frequency|exchanged|contains"


def filtered(kind: int, what: str, order: int, hz: float, btype: str) -> Fault:
    """One channel goes through a filter of its own."""

    def fault(c: CampaignCopy) -> Made:
        column = a_column(c, [kind])
        sos = butter(order, hz, btype, fs=1.0 / _STEP_S, output="sos")

        def through(y: np.ndarray) -> np.ndarray:
            start = np.nanmedian(y[:40])
            return start + sosfilt(sos, np.where(np.isfinite(y), y, start) - start)

        change_columns(c, [column], through)
        return Made(f"{column} {what}", (f"{column}.*({_UNLIKE})",), frozenset([column]))

    return fault


def hum(c: CampaignCopy) -> Made:
    """Half of its peak in 50 Hz hum on one channel."""
    column = a_column(c)

    def humming(y: np.ndarray) -> np.ndarray:
        size = 0.5 * float(np.nanmax(np.abs(y - np.nanmedian(y))))
        return y + size * np.sin(2.0 * np.pi * 50.3 * _STEP_S * np.arange(y.size) + c.rng.uniform(0.0, 6.0))

    change_columns(c, [column], humming)
    return Made(f"50 Hz hum on {column}", (f"{column}.*({_UNLIKE}|hum)",), frozenset([column]))


def noisy(c: CampaignCopy) -> Made:
    """White noise as large as half of the peak of one channel."""
    column = a_column(c)

    def with_noise(y: np.ndarray) -> np.ndarray:
        return y + 0.3 * float(np.nanmax(np.abs(y - np.nanmedian(y)))) * c.rng.standard_normal(y.size)

    change_columns(c, [column], with_noise)
    return Made(f"noise on {column}", (f"{column}.*({_UNLIKE})",), frozenset([column]))


def coarse(c: CampaignCopy) -> Made:
    """A converter of few bits: steps of a tenth of the peak."""
    column = a_column(c)

    def stepped(y: np.ndarray) -> np.ndarray:
        step = 0.2 * float(np.nanmax(np.abs(y - np.nanmedian(y))))
        return np.round(y / step) * step

    change_columns(c, [column], stepped)
    words = f"{column}.*({_UNLIKE}|steps|resolution|does not change|holds|stands still|dead)"
    return Made(f"{column} in steps of a fifth of its peak", (words,), frozenset([column]))


def offset(c: CampaignCopy) -> Made:
    """One channel has an offset of a tenth of its peak."""
    column = a_column(c)
    change_columns(c, [column], lambda y: y + 0.1 * float(np.nanmax(np.abs(y))))
    return Made(f"{column} has an offset", (f"{column}",), frozenset([column]), "offsets are eliminated by the fit")


def box_late(samples: int) -> Fault:
    """All sensors of one axle go through a box that lags behind."""

    def fault(c: CampaignCopy) -> Made:
        i = an_axle(c)
        columns = of_axle(i)
        change_columns(c, columns, lambda y: np.concatenate([np.full(samples, y[0]), y[:-samples]]))
        name = c.axles()[i - 1]
        words = tuple(f"{x}.*(late|lag|behind|delay)" for x in columns)
        words += (f"'{name}'.*(late|x_m|place|m instead)", r"one axle does not meet the bump")
        return Made(f"all sensors of axle {i} {5 * samples} ms late", words, frozenset(columns))

    return fault


def rattles(c: CampaignCopy) -> Made:
    """A loose sensor hits its mount: bursts of 35 Hz whenever it moves much."""
    column = a_column(c, [1, 2])

    def loose(y: np.ndarray) -> np.ndarray:
        size = np.abs(y - np.nanmedian(y))
        bursts = np.convolve(np.nan_to_num(size) > 0.3 * np.nanmax(size), np.exp(-np.arange(30) / 8.0))[: y.size]
        ring = np.sin(2.0 * np.pi * 35.0 * _STEP_S * np.arange(y.size))
        return y + 0.6 * float(np.nanmax(size)) * np.minimum(bursts, 1.0) * ring

    change_columns(c, [column], loose)
    return Made(f"{column} rattles", (f"{column}.*({_UNLIKE}|clip|range)",), frozenset([column]))


def rectified(c: CampaignCopy) -> Made:
    """An input that takes no negative voltage: readings below rest are cut off."""
    column = a_column(c)

    def cut(y: np.ndarray) -> np.ndarray:
        rest = float(np.nanmedian(y[:40]))
        return np.maximum(y, rest)

    change_columns(c, [column], cut)
    words = f"{column}.*({_UNLIKE}|clip|range|stands still|does not change|holds)"
    return Made(f"{column} shows no negative readings", (words,), frozenset([column]))


def another_axle(c: CampaignCopy) -> Made:
    """The deflection sensor of one axle is listed at another axle."""
    i, j = (int(v) + 1 for v in c.rng.choice(count_axles(c), 2, replace=False))
    one, other = of_axle(i)[0], of_axle(j)[0]
    place = dict(zip((one, other), (c.axles()[j - 1], c.axles()[i - 1]), strict=True))
    change_text(
        c, rf'^({one}|{other})( += .*axle = )"[^"]+"', lambda m: f'{m.group(1)}{m.group(2)}"{place[m.group(1)]}"'
    )
    words = (f"{one}.*{other}", f"{other}.*{one}", f"({one}|{other}).*(exchanged|which sensor|does not follow)")
    return Made(f"{one} and {other} listed at each other's axle", words, frozenset([one, other]))


FAULTS: dict[str, Fault] = {
    "deflection without its low frequencies": filtered(0, "through a high-pass of 1 Hz", 1, 1.0, "highpass"),
    "axle sensor through 5 Hz": filtered(1, "through a low-pass of 5 Hz", 2, 5.0, "lowpass"),
    "frame sensor through 5 Hz": filtered(2, "through a low-pass of 5 Hz", 2, 5.0, "lowpass"),
    "hum of 50 Hz": hum,
    "noise": noisy,
    "few bits": coarse,
    "offset of a sensor": offset,
    "sensors of an axle 100 ms late": box_late(20),
    "sensors of an axle 300 ms late": box_late(60),
    "sensor rattles": rattles,
    "negative readings cut off": rectified,
    "deflections at each other's axle": another_axle,
}
