"""Which declared mass is wrong where the masses of a vehicle contradict each other: found by elimination.

Masses enter the sums of every load case. One at a time, or all of one key, they are divided by every known factor. What
brings all sums to order, and leaves a vehicle that can stand on the road, is suspected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.factors import KNOWN, likely_unit
from sysid.campaign.statics import MASS_TOLERANCE, chain_sums, check_statics, static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import CampaignError
from sysid.wording import shorten

#: What leaves more of the sums' tolerance than the best by this share is no longer as good: readings are rounded.
_AS_GOOD = 0.1
#: A single wrong mass may leave this much more than several of one key.
_SINGLE = 0.3
#: Usual shares of an axle's load that is its unsprung mass, and of a body's weight that the body in front carries.
_UNSPRUNG, _HITCH = (0.03, 0.6), (-0.1, 0.7)
#: More causes than this name none.
_MOST = 4


@dataclass(frozen=True)
class _Mass:
    """A declared mass: its key, and in words which one it is."""

    key: str
    of: str


@dataclass(frozen=True)
class _Change:
    """What divides some masses: how unusual the vehicle is then, and the share of the tolerance that stays."""

    masses: tuple[int, ...]
    factor: float
    unusual: int
    left: float


def check_masses(vehicle: Vehicle, cases: Mapping[str, LoadCase]) -> None:
    """Check the masses of all load cases together.

    Raises
    ------
    CampaignError
        As :func:`sysid.campaign.statics.check_statics`, with the masses that would explain it, if there are.
    """
    for case in cases.values():
        try:
            check_statics(vehicle, case)
        except CampaignError as error:
            suspected = _Elimination(vehicle, cases).sentence()
            if not suspected:
                raise
            found = str(error).split("; ", 1)[0]
            raise CampaignError(f"{found}; {suspected}") from None


class _Elimination:
    def __init__(self, vehicle: Vehicle, cases: Mapping[str, LoadCase]) -> None:
        self._vehicle, self._cases = vehicle, cases
        axles, bodies = ([f"'{shorten(x.name)}'" for x in of] for of in (vehicle.axles, vehicle.bodies))
        self._masses = [_Mass("unsprung_mass_kg", name) for name in axles]
        self._masses += [_Mass("mass_kg", f"'{shorten(group.name)}'") for group in vehicle.groups]
        values = [[a.unsprung_mass_kg for a in vehicle.axles], [g.mass_kg for g in vehicle.groups]]
        for name, case in cases.items():
            where = f" in load case '{shorten(name)}'"
            self._masses += [_Mass("axle_loads_kg", axle + where) for axle in axles]
            self._masses += [_Mass("sprung_mass_kg", body + where) for body in bodies]
            values += [list(case.axle_loads_kg), list(case.sprung_mass_kg)]
        self._declared = np.concatenate([np.array(v, float) for v in values])

    def sentence(self) -> str:
        """The masses that explain the contradiction, with what they should be; empty where none or too many do."""
        found = [c for masses in self._candidates() for f in KNOWN if (c := self._judged(masses, f)) is not None]
        if not found:
            return ""
        usual = min(c.unusual for c in found)
        found = [c for c in found if c.unusual == usual]
        least = min(c.left for c in found)
        # One slip is likelier than several, and one between units than any other.
        good = [c for c in found if c.left < least + (_AS_GOOD if len(c.masses) > 1 else _SINGLE)]
        least_single = min((c.left for c in good if len(c.masses) == 1), default=np.inf)
        good = [c for c in good if len(c.masses) > 1 or c.left < least_single + _AS_GOOD]
        good = [c for c in good if self._unit(c)] or good
        told = {c.masses: self._words(c) for c in sorted(good, key=lambda c: -c.left)}
        if len(told) > _MOST:
            return ""
        return f"{'either ' if len(told) > 1 else ''}{'; or '.join(reversed(told.values()))}. Correct it."

    def _candidates(self) -> list[tuple[int, ...]]:
        """Every mass by itself, those of one key in one list, and those of one key everywhere."""
        count = len(self._masses)
        lists: dict[tuple[str, str], list[int]] = {}
        for i, mass in enumerate(self._masses):
            lists.setdefault((mass.key, mass.of.partition(" in load case ")[2]), []).append(i)
            lists.setdefault((mass.key, "*"), []).append(i)
        several = dict.fromkeys(tuple(v) for v in lists.values() if len(v) > 1)
        return [*((i,) for i in range(count)), *several]

    def _judged(self, masses: tuple[int, ...], factor: float) -> _Change | None:
        """The change, None where the sums or the statics still contradict each other."""
        changed = self._declared.copy()
        changed[list(masses)] /= factor
        vehicle, cases = self._records(changed)
        left, unusual = 0.0, 0
        for case in cases.values():
            left = max(left, *(abs(s.difference_kg) / (MASS_TOLERANCE * s.loads_kg) for s in chain_sums(vehicle, case)))
            if left > 1.0:
                return None
            try:
                statics = static_equilibrium(vehicle, case)
            except CampaignError:
                return None
            shares = np.array(vehicle.unsprung_mass_kg) / np.array(case.axle_loads_kg)
            weight = np.array(case.sprung_mass_kg) * vehicle.gravity_m_s2
            coupled = [b for b, body in enumerate(vehicle.bodies) if body.hitch_x_m is not None]
            unusual += _outside(shares, _UNSPRUNG) + _outside((statics.hitch_load_N / weight)[coupled], _HITCH)
        return _Change(masses, factor, unusual, left)

    def _records(self, masses: np.ndarray) -> tuple[Vehicle, dict[str, LoadCase]]:
        rest = iter(map(float, masses))
        axles = tuple(replace(a, unsprung_mass_kg=next(rest)) for a in self._vehicle.axles)
        groups = tuple(replace(g, mass_kg=next(rest)) for g in self._vehicle.groups)
        cases = {
            name: replace(
                case,
                axle_loads_kg=tuple(next(rest) for _ in case.axle_loads_kg),
                sprung_mass_kg=tuple(next(rest) for _ in case.sprung_mass_kg),
            )
            for name, case in self._cases.items()
        }
        return replace(self._vehicle, axles=axles, groups=groups), cases

    def _unit(self, change: _Change) -> str:
        return likely_unit("unsprung_mass_kg", change.factor)

    def _words(self, change: _Change) -> str:
        first, unit = self._masses[change.masses[0]], self._unit(change)
        likely = f", as if given {unit}" if unit else ""
        if len(change.masses) == 1:
            value = self._declared[change.masses[0]]
            right = float(f"{value / change.factor:.3g}")
            return f"{first.key} of {first.of} is {value:g}, where about {right:g} is expected{likely}"
        where = {self._masses[i].of.partition(" in ")[2] for i in change.masses}
        place = f" of {where.pop()}" if len(where) == 1 and "" not in where else ""
        return f"all {first.key}{place} are {change.factor:.4g} times what is expected{likely}"


def _outside(values: np.ndarray, usual: tuple[float, float]) -> int:
    return int(np.sum((values < usual[0]) | (values > usual[1])))
