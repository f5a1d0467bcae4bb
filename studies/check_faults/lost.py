"""Faults of loggers that lose readings: rows on the bump, modules that start late or end early."""

from __future__ import annotations

import numpy as np
import pandas as pd

from studies.check_faults.made import Fault, Made, a_column, change_columns, change_table
from studies.faults.campaign_copy import CampaignCopy


def rows_lost(count: int) -> Fault:
    """Rows are missing in every run while one of the axles is on the bump: that is said, and accuses no sensor."""

    def fault(c: CampaignCopy) -> Made:
        column = a_column(c, [1])

        def lose(t: pd.DataFrame) -> pd.DataFrame:
            y = t[column].to_numpy(float)
            first = int(np.nanargmax(np.abs(y - np.nanmedian(y)))) - int(c.rng.integers(count))
            return t.drop(index=t.index[max(first, 1) : max(first, 1) + count]).reset_index(drop=True)

        change_table(c, lose, c.files("bump_runs"))
        return Made(f"{count} rows missing while {column} is on the bump", (r"rows are missing",))

    return fault


def module(late: bool) -> Fault:
    """The module of one sensor shows one value until it has started, or after it has stopped."""

    def fault(c: CampaignCopy) -> Made:
        column = a_column(c)

        def still(y: np.ndarray) -> np.ndarray:
            y = y.copy()
            # While the truck is at rest: half of the time until it moves, or the last half second.
            away = np.abs(y - np.nanmedian(y[:40])) > 0.1 * np.nanmax(np.abs(y - np.nanmedian(y[:40])))
            if late:
                y[: max(60, int(np.argmax(away)) // 2)] = 0.0
            else:
                y[-100:] = y[-101]
            return y

        change_columns(c, [column], still)
        what = "starts late" if late else "ends early"
        return Made(f"the module of {column} {what}", (f"{column}.*does not change",), frozenset([column]))

    return fault


FAULTS: dict[str, Fault] = {
    "20 rows missing on the bump": rows_lost(20),
    "60 rows missing on the bump": rows_lost(60),
    "module starts late": module(True),
    "module ends early": module(False),
}
