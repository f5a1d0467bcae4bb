"""Kind, unit and sign of every column: what its name says against how it behaves."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.campaign.records import AUXILIARY_KINDS, KIND_DIMENSION, SensorKind
from sysid.campaign.units import STANDARD_GRAVITY_M_S2, is_other_quantity, recognised_unit, si_factor
from sysid.first_look.column_words import UNUSED_DIMENSIONS, NameSays, dimension_of, sensor_unit
from sysid.first_look.features import Look
from sysid.first_look.matching import Three

#: Share of the power in the band of wheel hop from which a column without a three counts as an axle's.
_HOPS = 0.35
#: Units of what a sensor without calibration gives: it may be any sensor.
_BARE_SIGNALS = frozenset(("v", "volt", "volts", "mv", "uv", "mv/v", "a", "ma"))
#: Units that loggers write, with the cost of taking them.
_LENGTHS = {"mm": 0.0, "m": 0.7, "cm": 1.0, "in": 1.2}
_ACCELERATIONS = {"g": 0.0, "m/s^2": 0.0, "mg": 1.5}
#: Largest departures [SI] that are usual on a bump or plank, and the spread of their logarithms: assumptions.
_USUAL: dict[SensorKind, tuple[float, float]] = {
    "suspension_deflection": (0.055, 0.7),
    "axle_acceleration": (25.0, 1.0),
    "body_acceleration": (7.0, 0.9),
}
#: |ln| between the factors of a three and those of the best units from which no unit explains them.
_NO_UNIT = 0.6
_MUCH_WORSE = 3.0  # cost by which another unit must be better to speak against the one that is said


@dataclass(frozen=True)
class KindGuess:
    """Kind, unit and sign of one column; `sure` where name or file and behaviour say the same of both.

    `kind` and `unit` None: not known.  `unused` says why it is no sensor of a campaign.  `why` are the reasons.
    """

    column: str
    kind: SensorKind | None
    unit: str | None
    sign: int
    sure: bool
    why: tuple[str, ...]
    unused: str | None = None


def guess_kinds(
    seen: Mapping[str, Sequence[Look]], said: Mapping[str, NameSays], threes: Sequence[Three]
) -> dict[str, KindGuess]:
    """Kind, unit and sign of every column of a layout.

    Parameters
    ----------
    seen
        Behaviour of each column, one per log in which it lives.
    said
        What each name says.
    threes
        From :func:`matched_threes`.
    """
    roles: dict[str, tuple[SensorKind, Three]] = {}
    for three in threes:
        roles[three.deflection] = ("suspension_deflection", three)
        roles[three.axle] = ("axle_acceleration", three)
        if three.body is not None:
            roles[three.body] = ("body_acceleration", three)
    units = {c: u for three in threes for c, u in _units_of(three, seen).items()}
    signs = {c: s for three in threes for c, s in _signs(three).items()}
    result = {}
    for column, of_logs in seen.items():
        told = told_unit(of_logs, said[column])
        role = roles.get(column)
        if role is None:
            without_motion = _other_quantity(column, said[column], told)
            if without_motion is not None:
                result[column] = without_motion
                continue
        if told is not None and dimension_of(told) not in ("length", "acceleration"):
            # A bare signal, such as volts: what it means in metres or m/s2 stands in no file.
            kind_of_role = role[0] if role else said[column].kind
            why_not = f"fits as {_NOUN[role[0]]}, but it" if role else "it"
            why_not = f"{why_not} is in {told}: a scale is needed"
            result[column] = KindGuess(column, kind_of_role, None, 1, False, (why_not,))
            continue
        kind, kind_sure, why = _kind(said[column], role and role[0], of_logs, told)
        unit, unit_sure, of_unit = _unit(kind, told, units.get(column), of_logs)
        sign = signs.get(column, 1) if role is not None and kind == role[0] else 1
        if sign < 0:
            why.append("moves opposite to the others of its axle, so it is turned")
        result[column] = KindGuess(column, kind, unit, sign, kind_sure and unit_sure and sign > 0, (*why, *of_unit))
    return result


_NOUN: dict[SensorKind, str] = {
    "suspension_deflection": "a deflection",
    "axle_acceleration": "an axle acceleration",
    "body_acceleration": "a frame acceleration",
    "speed": "the speed",
    "air_pressure": "the pressure of an air spring",
    "pitch_rate": "a pitch rate",
}


def _other_quantity(column: str, said: NameSays, told: str | None) -> KindGuess | None:
    """A speed, a pressure, an angular rate, or a column of no use; None where it may be a sensor of vertical motion."""
    dimension = None if told is None else dimension_of(told)
    bare = told is not None and told.casefold() in _BARE_SIGNALS
    if said.unused is not None and dimension in (None, "other", UNUSED_DIMENSIONS.get(said.unused)):
        return KindGuess(column, None, None, 1, True, (said.unused,), said.unused)
    if said.kind in AUXILIARY_KINDS:
        if dimension == KIND_DIMENSION[said.kind]:
            return KindGuess(column, said.kind, told, 1, True, ("name and unit agree",))
        why_not = "unit not known" if told is None else f"it is in {told}"
        return KindGuess(column, said.kind, None, 1, False, (f"{_NOUN[said.kind]} by its name, but {why_not}",))
    kind = next((k for k in sorted(AUXILIARY_KINDS) if KIND_DIMENSION[k] == dimension), None)
    if kind is not None:
        but = f"its name says {said.unused}" if said.unused else f"its name does not say {_NOUN[kind]}"
        return KindGuess(column, kind, told, 1, False, (f"its unit is {told}, but {but}",))
    if dimension == "other" and not bare:
        return KindGuess(column, None, None, 1, False, (f"it is in {told}",), f"in {told}")
    return None


def told_dimensions(seen: Mapping[str, Sequence[Look]], said: Mapping[str, NameSays]) -> dict[str, str]:
    """``length`` or ``acceleration`` of the columns whose unit their file or name says."""
    told = {column: told_unit(of_logs, said[column]) for column, of_logs in seen.items()}
    found = {column: dimension_of(unit) for column, unit in told.items() if unit is not None}
    return {column: d for column, d in found.items() if d in ("length", "acceleration")}


def may_move(look: Look, said: NameSays) -> bool:
    """Whether a column may be a deflection or an acceleration, by its unit, else by its name."""
    told = told_unit([look], said)
    if told is None:
        return said.kind not in AUXILIARY_KINDS
    return dimension_of(told) in ("length", "acceleration") or told.casefold() in _BARE_SIGNALS


def told_unit(of_logs: Sequence[Look], said: NameSays) -> str | None:
    """Unit that file or name say, as a campaign file writes it; one of another quantity as it stands; else None."""
    for written in (next((look.unit for look in of_logs if look.unit), None), said.unit):
        if written is not None:
            known = sensor_unit(written)
            if known is not None or is_other_quantity(written):
                return known[0] if known else written
    return None


def _dimension(unit: str) -> str:
    known = recognised_unit(unit)
    return known[1] if known else ""


def _kind(
    said: NameSays, role: SensorKind | None, of_logs: Sequence[Look], unit: str | None
) -> tuple[SensorKind | None, bool, list[str]]:
    """Kind, whether name and behaviour agree, and reasons."""
    by_name = said.kind
    if (
        by_name is not None
        and unit is not None
        and (by_name == "suspension_deflection") != (_dimension(unit) == "length")
    ):
        by_name = None
    hop = float(np.median([look.hop_share for look in of_logs])) if of_logs else 0.0
    if role is None and unit is not None and _dimension(unit) == "length":
        behaviour: SensorKind | None = "suspension_deflection" if by_name is None else None
        reason = "its unit is a length"
    elif role is None:
        behaviour = "axle_acceleration" if hop > _HOPS else None
        reason = f"{100.0 * hop:.0f} % of its power is wheel hop"
    else:
        behaviour = role
        reason = f"fits as {_NOUN[role]} to others"
    if by_name is None:
        return behaviour, False, [f"kind by behaviour: {reason}" if behaviour else "kind not known"]
    if behaviour is None:
        # Where one of a three is missing, the share of wheel hop still speaks for or against an axle.
        plausible = role is None and (hop <= _HOPS) == (by_name != "axle_acceleration")
        return by_name, plausible and _enough(of_logs), [f"{_NOUN[by_name]} by its name"]
    if behaviour == by_name:
        return by_name, True, ["name and behaviour agree"]
    if role is None:
        return by_name, False, [f"{_NOUN[by_name]} by its name, but {reason}"]
    return behaviour, False, [f"name says {_NOUN[by_name]}, but it {reason}"]


def _enough(of_logs: Sequence[Look]) -> bool:
    return any(look.alive for look in of_logs)


def _unit(
    kind: SensorKind | None, told: str | None, by_three: str | None, of_logs: Sequence[Look]
) -> tuple[str | None, bool, list[str]]:
    if kind is None:
        return told, False, []
    wanted = "length" if kind == "suspension_deflection" else "acceleration"
    if told is not None and _dimension(told) != wanted:
        told = None
    costs = _unit_costs(kind, of_logs)
    if not costs:
        return told, False, ["no reading moves"]
    if by_three == "":
        return told, False, ["no units give the factor between it and the sensors of its axle: one needs a scale"]
    best = by_three or min(costs, key=costs.__getitem__)
    if told is None:
        sizes = "the factors between the sensors" if by_three else "the size of its readings"
        return best, False, [f"unit by {sizes}"]
    of_told = costs.get(told, _cost_of(kind, told, of_logs, 0.0))
    size = np.median([look.size for look in of_logs])
    if by_three is not None and by_three != told:
        return by_three, False, [f"said to be in {told}, but readings up to {size:.3g} fit the other sensors in {best}"]
    if of_told > min(costs.values()) + _MUCH_WORSE:
        return told, False, [f"said to be in {told}, but readings up to {size:.3g} look like {best}"]
    return told, True, []


def _cost_of(kind: SensorKind, unit: str, of_logs: Sequence[Look], base: float) -> float:
    sizes = [look.size for look in of_logs if look.alive]
    usual, spread = _USUAL[kind]
    factor = si_factor(unit, "length" if kind == "suspension_deflection" else "acceleration")
    cost = base + (np.log(np.median(sizes) * factor / usual) / spread) ** 2 if sizes else base
    rest = float(np.median([look.rest for look in of_logs])) if of_logs else 0.0
    if (
        kind != "suspension_deflection"
        and abs(abs(rest * factor) - STANDARD_GRAVITY_M_S2) < 0.05 * STANDARD_GRAVITY_M_S2
    ):
        cost -= 4.0  # an accelerometer that shows gravity at rest
    return float(cost)


def _unit_costs(kind: SensorKind, of_logs: Sequence[Look]) -> dict[str, float]:
    if not any(look.alive for look in of_logs):
        return {}
    units = _LENGTHS if kind == "suspension_deflection" else _ACCELERATIONS
    return {unit: _cost_of(kind, unit, of_logs, base) for unit, base in units.items()}


def _units_of(three: Three, seen: Mapping[str, Sequence[Look]]) -> dict[str, str]:
    """Units of a three: the factors between its columns leave few choices, the sizes decide among them.

    ``""`` where no units give these factors: a sensor then needs a scale.
    """
    members: list[tuple[str, SensorKind]] = [
        (three.deflection, "suspension_deflection"),
        (three.axle, "axle_acceleration"),
    ]
    if three.body is not None:
        members.append((three.body, "body_acceleration"))
    costs = [_unit_costs(kind, seen[column]) for column, kind in members]
    best: tuple[float, tuple[str, ...], float] | None = None
    for chosen in itertools.product(*costs):
        length, *others = (si_factor(u, "length" if i == 0 else "acceleration") for i, u in enumerate(chosen))
        cost = sum(c[u] for c, u in zip(costs, chosen, strict=True))
        # Without the frame's share the factor of a pair is a little off.
        spread = 0.12 if three.body is not None else 0.3
        away = [np.log(abs(f) * length / o) for f, o in zip((three.alpha, three.beta), others, strict=False)]
        cost += sum((a / spread) ** 2 for a in away)
        if best is None or cost < best[0]:
            best = (float(cost), chosen, float(np.max(np.abs(away))))
    if best is None:
        return {}
    fits = best[2] < _NO_UNIT
    return {column: unit if fits else "" for (column, _), unit in zip(members, best[1], strict=True)}


def _signs(three: Three) -> dict[str, int]:
    """Which column of a three is upside down; that all are cannot be seen here."""
    if three.body is None:
        # Which of two is turned cannot be told: the one that moves the wrong way first.
        return {three.axle: -1} if three.alpha < 0.0 else {}
    a, b = int(np.sign(three.alpha)), int(np.sign(three.beta))
    turned = three.deflection if a < 0 and b < 0 else three.axle if a < 0 else three.body if b < 0 else None
    return {turned: -1} if turned is not None else {}
