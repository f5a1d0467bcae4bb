"""Faults of what is measured: sensors, loggers, clocks, the scan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from studies.faults.bookkeeping import Fault
from studies.faults.campaign_copy import CampaignCopy, DoesNotApply


def _where(c: CampaignCopy, kinds: tuple[str, ...] = ("bump_runs", "plank_drops")) -> list[str]:
    """Logs that the fault touches: one of them, or all of one kind."""
    files = c.files(c.pick(list(kinds)))
    return files if c.rng.random() < 0.5 else [c.pick(files)]


def _columns(c: CampaignCopy, file: str) -> list[str]:
    columns = c.columns(file)
    return columns if c.rng.random() < 0.3 else [c.pick(columns)]


def _changed(what: str, change: Callable[[CampaignCopy, np.ndarray], np.ndarray]) -> Fault:
    """A fault of the readings of one or all channels, of one or all logs."""

    def fault(c: CampaignCopy) -> str:
        files = _where(c)
        columns = _columns(c, files[0])

        def table(t: pd.DataFrame) -> pd.DataFrame:
            for column in columns:
                t[column] = change(c, t[column].to_numpy(float))
            return t

        for file in files:
            c.edit_log(file, table)
        return f"{what}: {len(columns)} channels ({columns[0]}) of {len(files)} logs ({files[0]})"

    return fault


def _noise(c: CampaignCopy, y: np.ndarray) -> np.ndarray:
    own = np.std(np.diff(y[:40])) / np.sqrt(2.0)
    return y + 100.0 * max(float(own), 1e-9) * c.rng.standard_normal(y.size)


def _clipped(c: CampaignCopy, y: np.ndarray) -> np.ndarray:
    return np.clip(y, *(0.3 * float(np.nanmax(np.abs(y))) * np.array([-1.0, 1.0])))


def _gaps(c: CampaignCopy, y: np.ndarray) -> np.ndarray:
    y = y.copy()
    for _ in range(int(c.rng.integers(1, 5))):
        first = int(c.rng.integers(0, max(y.size - 20, 1)))
        y[first : first + int(c.rng.integers(5, 300))] = np.nan
    return y


def _spikes(c: CampaignCopy, y: np.ndarray) -> np.ndarray:
    y = y.copy()
    y[c.rng.integers(0, y.size, 12)] += 20.0 * np.nanmax(np.abs(y)) * c.rng.choice([-1.0, 1.0], 12)
    return y


def _quantised(c: CampaignCopy, y: np.ndarray) -> np.ndarray:
    step = 0.15 * float(np.nanmax(np.abs(y))) or 1.0
    return np.round(y / step) * step


def _drifting(c: CampaignCopy, y: np.ndarray) -> np.ndarray:
    return y + np.linspace(0.0, 0.5 * float(np.nanmax(np.abs(y))), y.size)


def _rough(c: CampaignCopy, y: np.ndarray) -> np.ndarray:
    # Coloured noise below some 10 Hz, as a rough road excites, a third of the signal.
    white = c.rng.standard_normal(y.size + 40)
    smooth = np.convolve(white, np.hanning(20) / np.sqrt(np.sum(np.hanning(20) ** 2)), "same")[20:-20]
    return y + 0.33 * float(np.std(y)) * smooth


def _late(c: CampaignCopy, y: np.ndarray) -> np.ndarray:
    shift = int(c.rng.choice([4, 20, 60, 200]))
    return np.concatenate([np.full(shift, y[0]), y])[: y.size]


def upside_down(c: CampaignCopy) -> str:
    """All sensors of one axle, or one sensor, have the wrong sign."""
    kinds = ("bump_runs", "plank_drops") if c.rng.random() < 0.5 else ("bump_runs",)
    columns = c.columns(c.files("bump_runs")[0])
    number = c.pick([str(i + 1) for i in range(len(columns) // 3)])
    wrong = [x for x in columns if number in x] if c.rng.random() < 0.6 else [c.pick(columns)]

    def table(t: pd.DataFrame) -> pd.DataFrame:
        for column in wrong if set(wrong) <= set(t.columns) else t.columns[1:2]:
            t[column] = -t[column]
        return t

    for kind in kinds:
        for file in c.files(kind):
            c.edit_log(file, table)
    return f"{', '.join(wrong)} upside down in {' and '.join(kinds)}"


def clock_rate(c: CampaignCopy) -> str:
    """The clock of the logs runs at another rate."""
    factor = float(c.rng.choice([0.5, 0.9, 1.1, 2.0, 1000.0]))
    files = _where(c)
    for file in files:
        c.edit_log(file, lambda t: t.assign(**{t.columns[0]: factor * t[t.columns[0]]}))
    return f"clock of {len(files)} logs ({files[0]}) times {factor:g}"


def clock_starts_late(c: CampaignCopy) -> str:
    """The clock counts from something else than the start of the log."""
    files = _where(c)
    for file in files:
        c.edit_log(file, lambda t: t.assign(**{t.columns[0]: 2718.0 + t[t.columns[0]]}))
    return f"clock of {len(files)} logs ({files[0]}) starts at 2718 s"


def log_cut(c: CampaignCopy) -> str:
    """The record begins too late or ends too early."""
    files = _where(c)
    share, front = float(c.rng.choice([0.3, 0.6, 0.9])), bool(c.rng.random() < 0.5)

    def table(t: pd.DataFrame) -> pd.DataFrame:
        count = max(int(share * len(t)), 3)
        return t.tail(count) if front else t.head(count)

    for file in files:
        c.edit_log(file, table)
    return f"{'last' if front else 'first'} {100 * share:g} % of {len(files)} logs ({files[0]})"


def column_missing(c: CampaignCopy) -> str:
    """A log lacks a column."""
    file = c.pick(c.files(c.pick(["bump_runs", "plank_drops"])))
    column = c.pick(c.columns(file))
    c.edit_log(file, lambda t: t.drop(columns=column))
    return f"{column} missing from {file}"


def columns_shuffled(c: CampaignCopy) -> str:
    """The names stand over the wrong columns."""
    files = c.files("bump_runs")
    one, two = c.two(c.columns(files[0]))
    for file in files:
        c.edit_log(file, lambda t: t.rename(columns={one: two, two: one}))
    return f"{one} and {two} exchanged in all runs"


def _scan(what: str, change: Callable[[CampaignCopy, pd.DataFrame], pd.DataFrame]) -> Fault:
    def fault(c: CampaignCopy) -> str:
        path = c.folder / "bump_scan.csv"
        if not path.exists():
            raise DoesNotApply("no scan")
        change(c, pd.read_csv(path)).to_csv(path, index=False, float_format="%.9g")
        return what

    return fault


def _turned(t: pd.DataFrame, deg: float) -> pd.DataFrame:
    x, y = t["x_m"] - t["x_m"].mean(), t["y_m"] - t["y_m"].mean()
    a = np.radians(deg)
    return t.assign(x_m=x * np.cos(a) - y * np.sin(a), y_m=x * np.sin(a) + y * np.cos(a))


MEASURING: dict[str, Fault] = {
    "sensors upside down": upside_down,
    "noise times 100": _changed("noise times 100", _noise),
    "clipped": _changed("clipped at 30 % of the peak", _clipped),
    "constant": _changed("constant", lambda c, y: np.full(y.size, y[0])),
    "readings times 1000": _changed("readings times 1000", lambda c, y: 1000.0 * y),
    "readings a fifth off": _changed("gain 1.2", lambda c, y: 1.2 * y),
    "gaps": _changed("gaps", _gaps),
    "spikes": _changed("spikes", _spikes),
    "coarse steps": _changed("coarse steps", _quantised),
    "drift": _changed("drift by half the peak", _drifting),
    "rough road": _changed("coloured noise", _rough),
    "channel late": _changed("late", _late),
    "clock rate": clock_rate,
    "clock starts late": clock_starts_late,
    "log cut": log_cut,
    "column missing": column_missing,
    "columns exchanged": columns_shuffled,
    "scan noise": _scan("scan noise 30 mm", lambda c, t: t.assign(z_m=t["z_m"] + 0.03 * c.rng.standard_normal(len(t)))),
    "scan upside down": _scan("scan upside down", lambda c, t: t.assign(z_m=-t["z_m"])),
    "scan cut": _scan("first half of the scan", lambda c, t: t[t["x_m"] < t["x_m"].median()]),
    "scan of another bump": _scan("scan twice as high", lambda c, t: t.assign(z_m=2.0 * t["z_m"])),
    "scan sparse": _scan("300 points of the scan", lambda c, t: t.sample(300, random_state=1)),
    "scan turned": _scan("scan turned by 90 degrees", lambda c, t: _turned(t, 90.0)),
}
