"""What a fault did to a copy of a campaign, and what would be the right thing to say of it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from studies.faults.campaign_copy import CampaignCopy, DoesNotApply

EVERYWHERE = "*"


@dataclass(frozen=True)
class Made:
    """One fault: `said` in words; `words` regular expressions, one of which a right accusation matches.

    `columns` are those that are wrong, ``*`` where all are; `harmless` says why no k or c can be wrong by it.
    """

    said: str
    words: tuple[str, ...]
    columns: frozenset[str] = frozenset()
    harmless: str = ""


@dataclass(frozen=True)
class Copy(CampaignCopy):
    """A copy that knows whether its bump is the same from both sides."""

    symmetric: bool = False


Fault = Callable[[Copy], Made]


def count_axles(c: CampaignCopy) -> int:
    """Number of axles."""
    return len(c.axles())


def an_axle(c: CampaignCopy) -> int:
    """Number of an axle, from 1."""
    return int(c.rng.integers(1, count_axles(c) + 1))


def of_axle(number: int) -> tuple[str, str, str]:
    """Columns of deflection, axle and frame sensor of an axle in the runs."""
    return f"lvdt{number}_mm", f"axle{number}_accel_g", f"frame{number}_accel_g"


def a_column(c: CampaignCopy, kinds: Sequence[int] = (0, 1, 2)) -> str:
    """A column of the runs: 0 deflection, 1 axle, 2 frame."""
    return of_axle(an_axle(c))[int(c.rng.choice(list(kinds)))]


def change_columns(
    c: CampaignCopy,
    columns: Sequence[str],
    change: Callable[[np.ndarray], np.ndarray],
    files: Sequence[str] | None = None,
) -> None:
    """Replace readings of columns in all runs, or in the files named."""

    def table(t: pd.DataFrame) -> pd.DataFrame:
        for column in columns:
            t[column] = change(t[column].to_numpy(float))
        return t

    for file in files or c.files("bump_runs"):
        c.edit_log(file, table)


def change_table(c: CampaignCopy, change: Callable[[pd.DataFrame], pd.DataFrame], files: Sequence[str]) -> None:
    """Change the tables of logs."""
    for file in files:
        c.edit_log(file, change)


def change_text(c: CampaignCopy, pattern: str, new: str | Callable[[re.Match[str]], str], count: int = 0) -> None:
    """Replace in the campaign file, in lines that match."""
    c.write(re.sub(pattern, new, c.text, count=count, flags=re.M))


def numbers_of(c: CampaignCopy, key: str) -> list[list[float]]:
    """The lists of numbers behind `key = [...]`."""
    return [[float(v) for v in found.split(",")] for found in re.findall(rf"(?m)^{key} = \[([^\]]*)\]", c.text)]


def run_lines(c: CampaignCopy) -> list[str]:
    """Lines of the bump runs in the list of tests."""
    return [x for x in c.text.splitlines() if "file" in x and "nominal_speed_km_h" in x]


def drop_lines(c: CampaignCopy) -> list[str]:
    """Lines of the plank drops in the list of tests."""
    found = [x for x in c.text.splitlines() if "file" in x and "plank_height_m" in x]
    if not found:
        raise DoesNotApply("no drops")
    return found


def swap(c: CampaignCopy, text: str, one: str, two: str) -> str:
    """The text with two words exchanged."""
    return text.replace(one, "\0").replace(two, one).replace("\0", two)
