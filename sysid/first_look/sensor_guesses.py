"""One guess per column: its kind, and the axle by its name against the one by arrival."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from sysid.first_look.layouts import Layout
from sysid.first_look.records import SensorGuess


def sensor_guesses(
    layouts: Sequence[Layout],
    named: Mapping[str, int],
    axle_of: Mapping[str, int],
    agree: bool,
    *,
    drops: bool,
) -> tuple[SensorGuess, ...]:
    """One guess per column of the logs of runs, or of drops."""
    result: dict[str, SensorGuess] = {}
    everywhere = set.intersection(*(set(layout.kinds) for layout in layouts)) if layouts else set()
    for layout in layouts:
        of_three = {c: t.axle for t in layout.threes for c in (t.deflection, t.axle, t.body) if c}
        alone = Counter((g.kind, layout.said[c].side) for c, g in layout.kinds.items() if g.kind is not None)
        for column, guess in layout.kinds.items():
            said = layout.said[column]
            why = list(guess.why)
            if guess.unused is not None or guess.kind in _OF_NO_AXLE:
                axle, axle_sure = None, True
            elif drops and column in everywhere and guess.kind is not None and alone[(guess.kind, said.side)] == 1:
                # In the logs of all drops, so mounted at the axle under test: the list of drops says which.
                axle, axle_sure = None, True
            else:
                axle, axle_sure = _axle_of_column(column, of_three.get(column, column), named, axle_of, agree, why)
            why += [f"'{word}' has several meanings" for word in said.doubts if guess.unused is None]
            sure = guess.sure and axle_sure and not (said.doubts and guess.unused is None)
            sensor = SensorGuess(
                column, guess.kind, guess.unit, guess.sign, axle, said.side, sure, tuple(why), guess.unused
            )
            before = result.setdefault(column, sensor)
            if (before.kind, before.unit, before.sign) != (sensor.kind, sensor.unit, sensor.sign):
                result[column] = replace(before, sure=False, why=(*before.why, "other logs look different"))
    return tuple(sorted(result.values(), key=_place_in_list))


#: Kinds that belong to no axle.
_OF_NO_AXLE = ("speed", "pitch_rate")


def _axle_of_column(
    column: str, axle_column: str, named: Mapping[str, int], axle_of: Mapping[str, int], agree: bool, why: list[str]
) -> tuple[int | None, bool]:
    """Axle of a column, and whether its name and the arrivals say the same."""
    by_name, by_arrival = named.get(column), axle_of.get(axle_column)
    if by_name is not None and by_arrival is not None:
        if by_name == by_arrival and agree:
            return by_name, True
        unlike = f"axle by arrival; its name says {by_name + 1}"
        why.append(unlike if by_name != by_arrival else "names and arrivals of the axles do not agree")
        return by_arrival, False
    if by_arrival is not None:
        why.append(f"axle by arrival: {_ordinal(by_arrival)}")
        return by_arrival, False
    if by_name is not None:
        why.append("axle by its name alone")
        return by_name, False
    why.append("axle not known")
    return None, False


def _ordinal(index: int) -> str:
    return f"{index + 1}{({0: 'st', 1: 'nd', 2: 'rd'}).get(index, 'th')}"


def _place_in_list(sensor: SensorGuess) -> tuple[int, int, str]:
    rank = _KINDS.index(sensor.kind) if sensor.kind in _KINDS else len(_KINDS) + (sensor.unused is not None)
    return rank, 99 if sensor.axle is None else sensor.axle, sensor.column


_KINDS = ("suspension_deflection", "axle_acceleration", "body_acceleration", "air_pressure", "pitch_rate", "speed")
