"""Faults of loggers and files: rates, jumps, lags, rounding, records cut short, one file twice."""

from __future__ import annotations

import re
import shutil

import numpy as np

from studies.check_faults.made import EVERYWHERE, Fault, Made, a_column, change_table
from studies.faults.campaign_copy import CampaignCopy

_ALL = frozenset([EVERYWHERE])
_CLOCK = r"stamps|clock|rate|interval"


def rate(factor: float) -> Fault:
    """The stamps of all logs run at another rate."""

    def fault(c: CampaignCopy) -> Made:
        files = [*c.files("bump_runs"), *c.files("plank_drops")]
        change_table(c, lambda t: t.assign(**{t.columns[0]: factor * t[t.columns[0]]}), files)
        return Made(f"all clocks times {factor:g}", (_CLOCK, r"km/h"), _ALL)

    return fault


def rate_of_one(c: CampaignCopy) -> Made:
    """The clock of one run goes 20 % fast."""
    file = c.pick(c.files("bump_runs"))
    change_table(c, lambda t: t.assign(**{t.columns[0]: 1.2 * t[t.columns[0]]}), [file])
    return Made(f"clock of {file} times 1.2", (f"{file}.*({_CLOCK}|km/h)",), _ALL)


def slow_drift(c: CampaignCopy) -> Made:
    """All clocks are 300 ppm off."""
    files = c.files("bump_runs")
    change_table(c, lambda t: t.assign(**{t.columns[0]: 1.0003 * t[t.columns[0]]}), files)
    return Made("clocks 300 ppm off", (_CLOCK,), _ALL, "k goes with the square of frequency: 0.06 %")


def jump(c: CampaignCopy) -> Made:
    """The clock of one run jumps by 0.4 s in the middle."""
    file = c.pick(c.files("bump_runs"))

    def late(t):
        time = t[t.columns[0]].to_numpy(float)
        return t.assign(**{t.columns[0]: time + 0.4 * (np.arange(time.size) > time.size // 2)})

    change_table(c, late, [file])
    return Made(f"clock of {file} jumps by 0.4 s", (f"{file}.*(missing|jump|gap)",), _ALL)


def lag(samples: int) -> Fault:
    """One channel lags behind the others in all runs."""

    def fault(c: CampaignCopy) -> Made:
        column = a_column(c)

        def late(t):
            y = t[column].to_numpy(float)
            return t.assign(**{column: np.concatenate([np.full(samples, y[0]), y[:-samples]])})

        change_table(c, late, c.files("bump_runs"))
        return Made(f"{column} {5 * samples} ms late", (f"{column}.*(late|lag|behind|delay)",), frozenset([column]))

    return fault


def rounded(c: CampaignCopy) -> Made:
    """The stamps of all runs are rounded to hundredths of a second."""
    change_table(c, lambda t: t.assign(**{t.columns[0]: t[t.columns[0]].round(2)}), c.files("bump_runs"))
    return Made("stamps rounded to 0.01 s", (r"stamps|digits|repeat",), _ALL)


def cut(c: CampaignCopy) -> Made:
    """One record ends before the last axle has met the bump."""
    file = c.pick(c.files("bump_runs"))
    change_table(c, lambda t: t.head(int(0.25 * len(t))), [file])
    return Made(
        f"{file} ends after a quarter", (f"{file}.*(ends|begins|short|cut|never|no response|noise only)",), _ALL
    )


def begins_late(c: CampaignCopy) -> Made:
    """One record begins while the truck is on the bump."""
    file = c.pick(c.files("bump_runs"))

    def late(t):
        size = np.abs(t["axle1_accel_g"].to_numpy(float))
        return t.tail(len(t) - int(np.nanargmax(size)))

    change_table(c, late, [file])
    return Made(f"{file} begins on the bump", (f"{file}.*(begins|first sample|moves from)",), _ALL)


def same_content(c: CampaignCopy) -> Made:
    """One run has been copied over another one of another speed or load case."""
    runs = re.findall(r'file = "(bump_runs/[^"]+)" *, load_case = "(\w+)" *, nominal_speed_km_h = ([\d.]+)', c.text)
    one = runs[int(c.rng.integers(len(runs)))]
    other = c.pick([r[0] for r in runs if r[1:] != one[1:]])
    shutil.copyfile(c.folder / one[0], c.folder / other)
    return Made(f"{other} holds the readings of {one[0]}", (r"same (content|readings)|identical|copy",), _ALL)


def two_logs_in_one_folder(c: CampaignCopy) -> Made:
    """A drop has been copied over the drop of another axle."""
    files = c.files("plank_drops")
    one, two = files[0], files[-1]
    shutil.copyfile(c.folder / one, c.folder / two)
    return Made(f"{two} holds the readings of {one}", (r"same (content|readings)|identical|copy",), _ALL)


FAULTS: dict[str, Fault] = {
    "all clocks twice": rate(2.0),
    "all clocks 1000 times": rate(1000.0),
    "all clocks 10 % fast": rate(1.1),
    "one clock 20 % fast": rate_of_one,
    "clocks 300 ppm off": slow_drift,
    "clock jumps": jump,
    "one channel 5 ms late": lag(1),
    "one channel 20 ms late": lag(4),
    "one channel 100 ms late": lag(20),
    "stamps rounded": rounded,
    "record ends early": cut,
    "record begins late": begins_late,
    "one run copied": same_content,
    "one drop copied": two_logs_in_one_folder,
}
