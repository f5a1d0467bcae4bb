"""Logs with the same columns, looked at together: kind of every column, and columns that belong to one axle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.units import si_factor
from sysid.first_look.column_words import NameSays, columns_say
from sysid.first_look.features import Threes
from sysid.first_look.kinds import KindGuess, guess_kinds, told_dimensions
from sysid.first_look.matching import Three, matched_threes, upright
from sysid.first_look.records import SeenLog

#: How clearly all sensors of an axle must move the wrong way, in the middle of all runs.
_FALLS = 0.5


@dataclass(frozen=True)
class Layout:
    """Logs with the same columns, the kind of every column, and threes of columns that belong to one axle."""

    logs: tuple[SeenLog, ...]
    kinds: Mapping[str, KindGuess]
    said: Mapping[str, NameSays]
    threes: tuple[Three, ...]


def layouts_of_logs(
    logs: Sequence[SeenLog], fits: Mapping[str, Threes], joined: Mapping[str, Mapping[str, str]] | None = None
) -> list[Layout]:
    """Columns that the same loggers wrote, one layout for all logs with the same columns.

    Parameters
    ----------
    logs : what was seen of each log.
    fits : by file, threes of columns that belong to one axle.
    joined : by file, the files of all loggers whose columns a log has.
    """
    groups: dict[frozenset[str], list[SeenLog]] = {}
    for log in logs:
        groups.setdefault(frozenset(log.columns), []).append(log)
    result = []
    for columns, members in groups.items():
        seen = {c: [look for log in members for look in log.looks if look.name == c] for c in sorted(columns)}
        alive = {c: [look for look in of_logs if look.alive] or of_logs for c, of_logs in seen.items()}
        hop = {c: float(np.median([look.hop_share for look in of_logs])) for c, of_logs in alive.items()}
        said = columns_say(sorted(columns))
        files = [f for log in members for f in (joined or {}).get(log.file, {"": log.file}).values()]
        of_members = [fits[f] for f in files if f in fits]
        kinds = {c: s.kind for c, s in said.items()}
        threes = tuple(upright(t, kinds) for t in matched_threes(of_members, hop, told_dimensions(alive, said)))
        result.append(Layout(tuple(members), guess_kinds(alive, said, threes), said, threes))
    return result


def logged_speeds(layouts: Sequence[Layout]) -> dict[str, float]:
    """Speed [km/h] in the middle of each log that has a sensor of it whose unit is known."""
    result = {}
    for layout in layouts:
        units = {c: g.unit for c, g in layout.kinds.items() if g.kind == "speed" and g.unit is not None}
        for log in layout.logs:
            shown = [
                3.6 * look.middle * si_factor(units[look.name], "speed") for look in log.looks if look.name in units
            ]
            shown = [speed for speed in shown if speed > 0.0]
            if shown:
                result[log.file] = float(np.median(shown))
    return result


def righted(layout: Layout, runs: Sequence[SeenLog]) -> Layout:
    """The layout with all sensors of an axle turned that falls where an axle meets a bump."""
    kinds = dict(layout.kinds)
    for three in layout.threes:
        up = {three.deflection: -1, three.axle: 1} | ({three.body: 1} if three.body else {})
        lifts = [
            float(np.mean([look.lift * kinds[look.name].sign * up[look.name] for look in log.looks if look.name in up]))
            for log in runs
        ]
        if lifts and float(np.median(lifts)) < -_FALLS:
            for column in up:
                guess = kinds[column]
                why = (*guess.why, "all sensors of this axle move as if it fell where it meets the bump")
                kinds[column] = replace(guess, sign=-guess.sign, sure=False, why=why)
    return replace(layout, kinds=kinds)
