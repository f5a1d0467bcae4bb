"""Faults of sensors: signs, units, columns, gains, and what wears or breaks."""

from __future__ import annotations

import re

import numpy as np

from studies.check_faults.made import (
    Fault,
    Made,
    a_column,
    an_axle,
    change_columns,
    change_table,
    count_axles,
    drop_lines,
    of_axle,
)
from studies.faults.campaign_copy import CampaignCopy

_SIGN = r"sign|upside|opposite|flipped"


def axle_upside_down(c: CampaignCopy) -> Made:
    """The three sensors of one axle have the wrong sign in all runs."""
    i = an_axle(c)
    columns = of_axle(i)
    change_columns(c, columns, np.negative)
    return Made(f"all sensors of axle {i} upside down", tuple(f"{x}.*({_SIGN})" for x in columns), frozenset(columns))


def everything_upside_down(c: CampaignCopy) -> Made:
    """All sensors of all runs have the wrong sign."""
    columns = [x for i in range(count_axles(c)) for x in of_axle(i + 1)]
    change_columns(c, columns, np.negative)
    return Made("all sensors upside down", (f"all signs|({_SIGN})",), frozenset(columns))


def upside_down(kind: int) -> Fault:
    """One sensor has the wrong sign in all runs."""

    def fault(c: CampaignCopy) -> Made:
        column = a_column(c, [kind])
        change_columns(c, [column], np.negative)
        return Made(f"{column} upside down", (f"{column}.*({_SIGN})",), frozenset([column]))

    return fault


def drop_upside_down(c: CampaignCopy) -> Made:
    """One sensor has the wrong sign in all drops of one axle."""
    column = ["frame_axle_mm", "axle_accel_g", "frame_accel_g"][int(c.rng.integers(3))]
    i = an_axle(c)
    name = c.axles()[i - 1]
    files = [re.findall(r'file = "([^"]+)"', x)[0] for x in drop_lines(c) if f'"{name}"' in x]
    change_columns(c, [column], np.negative, files)
    return Made(f"{column} upside down in the drops of axle {i}", (f"{column}.*({_SIGN})",), frozenset([column]))


def wrong_unit(kind: int, *declared: str) -> Fault:
    """One sensor is declared in another unit than its file has."""

    def fault(c: CampaignCopy) -> Made:
        column, unit = a_column(c, [kind]), c.pick(list(declared))
        c.write(re.sub(rf'(?m)^({column} .*unit = )"[^"]+"', rf'\1"{unit}"', c.text))
        return Made(
            f"{column} declared in {unit}", (f"{column}.*(unit|set unit|file is in|range)",), frozenset([column])
        )

    return fault


def unit_of_a_kind(kind: str, unit: str) -> Fault:
    """All sensors of a kind are declared in another unit than their files have."""

    def fault(c: CampaignCopy) -> Made:
        columns = re.findall(rf"(?m)^(\S+) += .*{kind}", c.text)
        c.write(re.sub(rf'(?m)^(\S+ += .*{kind}.*unit = )"[^"]+"', rf'\1"{unit}"', c.text))
        words = tuple(f"{column}.*(unit|file is in|range)" for column in columns)
        return Made(f"every {kind} declared in {unit}", words, frozenset(columns))

    return fault


def exchanged(one_kind: int, other_kind: int) -> Fault:
    """Two columns have each other's names in all runs."""

    def fault(c: CampaignCopy) -> Made:
        i, j = (int(v) + 1 for v in c.rng.choice(count_axles(c), 2, replace=False))
        if one_kind != other_kind:
            j = i
        one, two = of_axle(i)[one_kind], of_axle(j)[other_kind]
        change_table(c, lambda t: t.rename(columns={one: two, two: one}), c.files("bump_runs"))
        words = (f"{one}.*{two}.*exchanged", f"{two}.*{one}.*exchanged", f"({one}|{two}).*(exchanged|which sensor)")
        return Made(f"{one} and {two} exchanged", words, frozenset([one, two]))

    return fault


def axles_exchanged(c: CampaignCopy) -> Made:
    """All sensors of two axles stand under each other's names in all runs."""
    i, j = sorted(int(v) + 1 for v in c.rng.choice(count_axles(c), 2, replace=False))
    names = dict(zip((*of_axle(i), *of_axle(j)), (*of_axle(j), *of_axle(i)), strict=True))
    change_table(c, lambda t: t.rename(columns=names), c.files("bump_runs"))
    return Made(f"sensors of axles {i} and {j} exchanged", (r"exchanged|wrong order",), frozenset(names))


def gain(kind: int, *factors: float) -> Fault:
    """One sensor reads too much or too little in all runs."""

    def fault(c: CampaignCopy) -> Made:
        column, factor = a_column(c, [kind]), float(c.rng.choice(factors))
        change_columns(c, [column], lambda y: factor * y)
        harmless = "gains are eliminated by the fit; 2 % moves k by less" if abs(factor - 1.0) < 0.03 else ""
        return Made(
            f"{column} times {factor:g}",
            (f"{column}.*(times what|calibration|gain)",),
            frozenset([column]),
            harmless,
        )

    return fault


def clipped(c: CampaignCopy) -> Made:
    """One sensor clips below its declared range."""
    column = a_column(c)
    change_columns(c, [column], lambda y: np.clip(y, *(0.4 * float(np.nanmax(np.abs(y))) * np.array([-1.0, 1.0]))))
    return Made(f"{column} clipped at 40 % of its peak", (f"{column}.*clip",), frozenset([column]))


def drift(c: CampaignCopy) -> Made:
    """The zero of one sensor wanders by 40 % of its peak over the record."""
    column = a_column(c)
    change_columns(c, [column], lambda y: y + np.linspace(0.0, 0.4 * float(np.nanmax(np.abs(y))), y.size))
    return Made(f"{column} drifts by 40 % of its peak", (f"{column}.*(drift|wander|level|zero)",), frozenset([column]))


def crosstalk(c: CampaignCopy) -> Made:
    """A quarter of a neighbouring channel leaks into one channel."""
    kind = int(c.rng.integers(3))
    i, j = (int(v) + 1 for v in c.rng.choice(count_axles(c), 2, replace=False))
    one, other = of_axle(i)[kind], of_axle(j)[kind]
    change_table(c, lambda t: t.assign(**{one: t[one] + 0.25 * t[other]}), c.files("bump_runs"))
    words = (f"{one}.*(crosstalk|leak|contain|does not follow|also shows)",)
    return Made(f"a quarter of {other} in {one}", words, frozenset([one]))


def mount_slip(c: CampaignCopy) -> Made:
    """A deflection sensor slips on its mount by 10 mm during every run."""
    column = of_axle(an_axle(c))[0]

    def slip(y: np.ndarray) -> np.ndarray:
        y = y.copy()
        y[int(np.nanargmax(np.abs(y - y[0]))) :] += 10.0
        return y

    change_columns(c, [column], slip)
    return Made(f"{column} slips by 10 mm", (f"{column}.*(slip|jump|level|zero|drift|mount)",), frozenset([column]))


def holds_last_value(c: CampaignCopy) -> Made:
    """A radio link holds the last value for 60 to 200 ms, six times per run."""
    column = a_column(c)

    def held(y: np.ndarray) -> np.ndarray:
        y = y.copy()
        moving = int(np.nanargmax(np.abs(y - np.nanmedian(y))))
        for k in range(6):
            first = int(np.clip(moving - 100 + k * 90 + c.rng.integers(60), 1, y.size - 60))
            y[first : first + int(c.rng.integers(12, 40))] = y[first - 1]
        return y

    change_columns(c, [column], held)
    return Made(
        f"{column} holds its last value", (f"{column}.*(does not change|holds|stands still)",), frozenset([column])
    )


def empty_cells(c: CampaignCopy) -> Made:
    """A fifth of the readings of one sensor are missing in one piece."""
    column = a_column(c)
    first = float(c.rng.uniform(0.1, 0.6))

    def gap(y: np.ndarray) -> np.ndarray:
        y = y.copy()
        y[int(first * y.size) : int((first + 0.2) * y.size)] = np.nan
        return y

    change_columns(c, [column], gap)
    return Made(f"a fifth of {column} missing", (f"{column}.*(lost|missing)",), frozenset([column]))


def spikes(c: CampaignCopy) -> Made:
    """Fifteen spikes in one channel of every run."""
    column = a_column(c)

    def spiky(y: np.ndarray) -> np.ndarray:
        y = y.copy()
        at = c.rng.choice(y.size, 15, replace=False)
        y[at] += 5.0 * np.nanmax(np.abs(y)) * c.rng.choice([-1.0, 1.0], 15)
        return y

    change_columns(c, [column], spiky)
    return Made(f"spikes in {column}", (f"{column}.*(spike|range|beyond)",), frozenset([column]))


def constant(c: CampaignCopy) -> Made:
    """One sensor shows one value."""
    column = a_column(c)
    change_columns(c, [column], lambda y: np.full(y.size, y[0]))
    return Made(f"{column} constant", (f"{column}.*dead",), frozenset([column]))


def noise_only(c: CampaignCopy) -> Made:
    """One sensor shows its noise alone."""
    column = a_column(c)
    change_columns(c, [column], lambda y: y[0] + float(np.std(y[:40])) * c.rng.standard_normal(y.size))
    words = (f"{column}.*(noise only|dead|does not follow)",)
    return Made(f"{column} shows noise only", words, frozenset([column]))


def copied(kind: int) -> Fault:
    """One column holds a copy of that of another axle."""

    def fault(c: CampaignCopy) -> Made:
        i, j = (int(v) + 1 for v in c.rng.choice(count_axles(c), 2, replace=False))
        one, other = of_axle(i)[kind], of_axle(j)[kind]
        change_table(c, lambda t: t.assign(**{one: t[other]}), c.files("bump_runs"))
        words = (f"({one}|{other}).*(same readings|copy|identical)",)
        return Made(f"{one} is a copy of {other}", words, frozenset([one, other]))

    return fault


FAULTS: dict[str, Fault] = {
    "axle upside down": axle_upside_down,
    "all upside down": everything_upside_down,
    "deflection upside down": upside_down(0),
    "axle sensor upside down": upside_down(1),
    "frame sensor upside down": upside_down(2),
    "drop sensor upside down": drop_upside_down,
    "unit of a deflection": wrong_unit(0, "m", "cm", "in"),
    "unit of an axle sensor": wrong_unit(1, "m/s^2", "mg"),
    "unit of a frame sensor": wrong_unit(2, "m/s^2", "mg"),
    "unit of all deflections": unit_of_a_kind("suspension_deflection", "cm"),
    "unit of all axle sensors": unit_of_a_kind("axle_acceleration", "m/s^2"),
    "deflections exchanged": exchanged(0, 0),
    "axle sensors exchanged": exchanged(1, 1),
    "frame sensors exchanged": exchanged(2, 2),
    "axle and frame exchanged": exchanged(1, 2),
    "sensors of two axles exchanged": axles_exchanged,
    "deflection 2 % off": gain(0, 0.98, 1.02),
    "deflection 10 % off": gain(0, 0.9, 1.1),
    "axle sensor 20 % off": gain(1, 0.8, 1.2),
    "frame sensor 10 % off": gain(2, 0.9, 1.1),
    "frame sensor 20 % off": gain(2, 0.8, 1.2),
    "clipped": clipped,
    "drift": drift,
    "crosstalk": crosstalk,
    "mount slips": mount_slip,
    "last value held": holds_last_value,
    "readings missing": empty_cells,
    "spikes": spikes,
    "dead": constant,
    "noise only": noise_only,
    "copy of a deflection": copied(0),
    "copy of an axle sensor": copied(1),
}
