"""Stamps of a log: hiccups of the logger are left out with a message, a clock that cannot be right is refused."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from sysid import limits
from sysid.errors import DataRejectedError
from sysid.logs.channels import Clock
from sysid.logs.stamps import HICCUPS, as_known, spread

BAD_STAMP_SHARE = HICCUPS  # up to this share of repeated or empty stamps is a hiccup of the logger
SAME_STEP = 1e-3  # rounding of the printed stamps
_AGREES = 0.01  # steps that differ by less from the declared one are not worth a word
_DAY_S = 86400.0
# Steps further than this from the declared one, either way, are of another unit or wrongly declared (an assumption).
_FAR = 20.0
_NEAR_UNIT = 2.0  # rounding of stamps in a large unit
#: How many of a unit are a second.
_COUNTS = {"ns": 1e9, "us": 1e6, "ms": 1e3, "minutes": 1.0 / 60.0, "hours": 1.0 / 3600.0, "days": 1.0 / _DAY_S}
_NEAR_MIDNIGHT_S = 60.0  # a step back of a day but for this is midnight on a clock that shows the time of day


@dataclass(frozen=True)
class CleanClock:
    """Stamps that increase strictly (n,) [s], the rows they stand in, and their median step [s]."""

    stamps: np.ndarray
    rows: np.ndarray
    step_s: float


def clean_clocks(
    clocks: Mapping[int, Clock], declared_s: float, label: str, messages: list[str], judged: Collection[int]
) -> dict[int, CleanClock]:
    """Clean the stamps of all clocks of a log.

    Parameters
    ----------
    clocks : stamps as the file has them, by any key.
    declared_s : declared sample interval [s], taken as the step where the stamps agree with it but for rounding.
    label : name of the file.
    messages : receives what was left out, and steps that differ from the declared one.
    judged : keys of the clocks whose steps are compared with the declared one.

    Raises
    ------
    DataRejectedError
        If the time of a clock does not advance or jumps, the steps of all clocks are far from the declared one, as
        those of another unit are, or two clocks of sensors share no moment.
    """
    found = {k: _clean_stamps(c, label, declared_s, messages) for k, c in clocks.items()}
    steps = {key: float(np.median(np.diff(stamps))) for key, (stamps, _) in found.items()}
    # A channel may be far slower or faster than the declared one beside it.
    nearest = min(judged, key=lambda key: abs(np.log(steps[key] / declared_s)))
    _refuse_unit(found[nearest][0], steps[nearest], declared_s, label, clocks[nearest].name)
    if clocks[nearest].written is not None and abs(steps[nearest] / declared_s - 1.0) >= _AGREES:
        raise DataRejectedError(
            f"{label}: several rows share each time stamp in column '{clocks[nearest].name}'; by their count the rows "
            f"are {steps[nearest]:.4g} s apart, acquisition.sample_interval_s says {declared_s:g} s; correct it, or "
            "export the log with more digits in the time column."
        )
    result = {}
    for key, (stamps, rows) in found.items():
        clock, step = clocks[key], steps[key]
        _check_span(stamps, rows, step, label, clock)
        if abs(step / declared_s - 1.0) < SAME_STEP:
            step = declared_s
        elif key == nearest and abs(step / declared_s - 1.0) >= _AGREES:
            messages.append(
                f"{label}: the time stamps are {step:.4g} s apart, acquisition.sample_interval_s says {declared_s:g} "
                "s; the stamps are used."
            )
        result[key] = CleanClock(stamps, rows, step)
    _check_together({key: found[key][0] for key in judged}, clocks, label)
    return result


def _check_together(stamps: Mapping[int, np.ndarray], clocks: Mapping[int, Clock], label: str) -> None:
    """Refuse clocks that share no moment, as a date in one group and seconds since the start in another."""
    first = min(stamps, key=lambda key: stamps[key][-1])
    last = max(stamps, key=lambda key: stamps[key][0])
    if stamps[last][0] > stamps[first][-1]:
        raise DataRejectedError(
            f"{label}: the time in '{clocks[first].name}' ends at {stamps[first][-1]:.10g} s, that in "
            f"'{clocks[last].name}' begins at {stamps[last][0]:.10g} s: their channels were not recorded together, or "
            "count from different moments; write both with one time, or leave out the sensors of one."
        )


def _clean_stamps(clock: Clock, label: str, declared_s: float, messages: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps that increase strictly, and the rows they stand in."""
    stamps, column, first_row = clock.time_s, clock.name, clock.first_row
    rows = np.flatnonzero(np.isfinite(stamps))
    allowed = max(2, int(BAD_STAMP_SHARE * stamps.size))
    empty = stamps.size - rows.size
    if rows.size < 2:
        raise DataRejectedError(
            f"{label} has {rows.size} row{'' if rows.size == 1 else 's'} with a time stamp in column '{column}', "
            "expected at least 2; export the log again."
        )
    # Blank lines at the very end come from editors and mean nothing.
    inside = rows[-1] + 1 - rows.size
    if inside > allowed:
        first = int(np.flatnonzero(~np.isfinite(stamps))[0])
        raise DataRejectedError(
            f"{label}: {empty} of {stamps.size} rows have no time stamp in column '{column}', the first in row "
            f"{first + first_row}; export the log again."
        )
    if inside:
        messages.append(f"{label}: {inside} rows without a time stamp were left out.")
    steps = np.diff(stamps[rows])
    back = np.flatnonzero(steps < 0.0)
    if back.size:
        row = rows[back[0] + 1]
        midnight = abs(steps[back[0]] + _DAY_S) < _NEAR_MIDNIGHT_S
        remedy = (
            f"it passes midnight there: add {_DAY_S:.0f} s to the stamps from that row on"
            if midnight
            else "put the rows in order of time or split the log"
        )
        raise DataRejectedError(
            f"{label}: the time in column '{column}' runs backward in row {row + first_row} (from "
            f"{stamps[rows[back[0]]]:.10g} s to {stamps[row]:.10g} s); {remedy}."
        )
    repeated = np.flatnonzero(steps == 0.0) + 1
    if repeated.size > allowed or rows.size - repeated.size < 2:
        row = rows[repeated[0]]
        repeats = (
            f"{label}: {repeated.size} time stamps in column '{column}' repeat the one before, the first in row "
            f"{row + first_row} ({stamps[row]:.10g} s)"
        )
        even = spread(stamps[rows], rows, declared_s)
        if even is None:
            raise DataRejectedError(
                f"{repeats}, and rows every {declared_s:g} s, as acquisition.sample_interval_s says, do not explain "
                "them; correct it, or export the log with more digits in the time column."
            )
        messages.append(f"{repeats}; the rows are taken as {declared_s:g} s apart, as the campaign file says.")
        return even, rows
    if repeated.size:
        messages.append(
            f"{label}: {repeated.size} row{'s' if repeated.size > 1 else ''} with a repeated time stamp (the first is "
            f"row {rows[repeated[0]] + first_row}) {'were' if repeated.size > 1 else 'was'} left out."
        )
        rows = np.delete(rows, repeated)
    elif clock.written is not None:
        known = as_known(clock.written[rows], rows, declared_s)
        if known is not None:
            return known, rows
    return stamps[rows], rows


def _refuse_unit(stamps: np.ndarray, step: float, declared: float, label: str, column: str) -> None:
    ratio = step / declared
    if 1.0 / _FAR <= ratio <= _FAR:
        return
    unit = next((u for u, counts in _COUNTS.items() if 1.0 / _NEAR_UNIT < ratio / counts < _NEAR_UNIT), None)
    if unit == "days":
        raise DataRejectedError(
            f"{label}: the time in column '{column}' counts days ({stamps[0]:.10g}, {step:.3g} apart), as spreadsheets "
            "do; export the time in seconds."
        )
    times = f"{ratio:.4g} times" if ratio > 1.0 else f"1/{1.0 / ratio:.4g} of"
    remedy = "; correct acquisition.sample_interval_s or write them in seconds"
    if unit is not None:
        remedy = f", so they are probably in {unit}; " + (
            "name the column time_ms" if unit == "ms" else "write them in seconds"
        )
        remedy += ", unless acquisition.sample_interval_s is wrong"
    raise DataRejectedError(
        f"{label}: the stamps in column '{column}' are {step:.4g} s apart, {times} the declared {declared:g} s{remedy}."
    )


def _check_span(stamps: np.ndarray, rows: np.ndarray, step: float, label: str, clock: Clock) -> None:
    """Refuse a clock that jumps: whoever lays an even grid over the record would need memory for all of it."""
    span = float(stamps[-1] - stamps[0])
    most_of_rows = limits.LOG_PAUSES * stamps.size * step + limits.LOG_PAUSE_S
    most = min(limits.LOG_SECONDS, limits.LOG_STEPS * step, most_of_rows)
    if span <= most:
        return
    jump = int(np.argmax(np.diff(stamps))) + 1
    raise DataRejectedError(
        f"{label}: the time in column '{clock.name}' spans {span:.6g} s, but {stamps.size} rows {step:.4g} s "
        f"apart may span at most {most:.6g} s; it jumps by {stamps[jump] - stamps[jump - 1]:.6g} s in row "
        f"{rows[jump] + clock.first_row}: correct the stamps or cut the log."
    )
