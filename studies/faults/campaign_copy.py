"""A copy of a campaign that a fault may damage: its text and its logs, with a random generator."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd


class DoesNotApply(Exception):
    """The fault asks for something that this campaign does not have."""


@dataclass(frozen=True)
class CampaignCopy:
    """Folder of the copy and the generator that decides where and how much."""

    folder: Path
    rng: np.random.Generator

    @property
    def text(self) -> str:
        """The campaign file."""
        return (self.folder / "campaign.toml").read_text(encoding="utf-8")

    def write(self, text: str) -> None:
        """Replace the campaign file."""
        if text == self.text:
            raise DoesNotApply("nothing to change")
        (self.folder / "campaign.toml").write_text(text, encoding="utf-8")

    def files(self, kind: str) -> list[str]:
        """Logs of ``bump_runs`` or ``plank_drops`` as the campaign file names them."""
        return sorted(set(re.findall(rf'file = "({kind}/[^"]+)"', self.text)))

    def pick(self, values: list[str]) -> str:
        """One of several, at random."""
        if not values:
            raise DoesNotApply("nothing to choose from")
        return values[int(self.rng.integers(len(values)))]

    def two(self, values: list[str]) -> tuple[str, str]:
        """Two different ones, at random."""
        if len(values) < 2:
            raise DoesNotApply("fewer than two to choose from")
        a, b = self.rng.choice(len(values), 2, replace=False)
        return values[int(a)], values[int(b)]

    def axles(self) -> list[str]:
        """Names of the axles, front to rear."""
        return re.findall(r'\[\[vehicle\.axle\]\][^\n]*\nname = "([^"]+)"', self.text)

    def rescale(self, key: str, factor: Callable[[], float], which: int | None = None) -> str:
        """Multiply numbers of `key = value` or `key = [...]`, all or the `which`-th; what was done, in words."""
        number = 0
        told: list[str] = []

        def one(found: re.Match[str]) -> str:
            nonlocal number
            if float(found.group(0)) == 0.0:
                return found.group(0)
            number += 1
            if which is not None and number - 1 != which:
                return found.group(0)
            f = factor()
            told.append(f"{f:.3g}")
            return f"{float(found.group(0)) * f:.6g}"

        def line(found: re.Match[str]) -> str:
            return found.group(1) + re.sub(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", one, found.group(2))

        self.write(re.sub(rf"(\b{key} = )(\[[^\]\n]*\]|-?[\d.e-]+)", line, self.text))
        return f"{key} times {', '.join(sorted(set(told))[:4])}"

    def count(self, key: str) -> int:
        """How many numbers other than zero stand behind a key."""
        values = re.findall(rf"\b{key} = (\[[^\]\n]*\]|-?[\d.e-]+)", self.text)
        return sum(float(n) != 0.0 for v in values for n in re.findall(r"-?\d+(?:\.\d+)?", v))

    def one_of(self, key: str) -> int:
        """Place of one of the numbers behind a key, at random."""
        if (count := self.count(key)) == 0:
            raise DoesNotApply(f"no {key}")
        return int(self.rng.integers(count))

    def edit_log(self, file: str, change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
        """Change the table of a log."""
        path = self.folder / file
        change(pd.read_csv(path)).to_csv(path, index=False, float_format="%.9g")

    def columns(self, file: str) -> list[str]:
        """Columns of a log but for its time."""
        return list(pd.read_csv(self.folder / file, nrows=1).columns[1:])
