"""Load cases, pitch inertias and axle loads that the motion of the frames contradicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from sysid.bookkeeping.force_balance import Balance, OwnSprings, RunSpectra, balance, hinges
from sysid.campaign.records import Campaign
from sysid.campaign.statics import static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import CampaignError
from sysid.wording import shorten

#: A run is of another load case where that leaves less than this share of what the listed one leaves unexplained.
OTHER_CASE = 0.55
#: Of most runs: less than this.
ALL_CASES = 0.8
#: A free inertia or centre of gravity that leaves less than this share of what another load case leaves is the likelier
#: explanation; the first share holds where springs would push the wrong way with the listed masses only.
FREED_SURELY, FREED_INSTEAD = 0.1, 0.5
#: Axle loads in another order, or of one side, leave less than this share of what the listed ones leave unexplained,
#: and no more than this multiple of what a free inertia or centre of gravity leaves.
OTHER_LOADS, AS_GOOD = 0.5, 1.5
#: Cabs and cargo on springs of their own have these frequencies [Hz], and up to this share of the mass of their body.
#: Axle loads are wrong only where they leave less than this share of what such a part leaves unexplained: 0.93 and more
#: with cabs of 500 to 900 kg, 0.81 and less with reversed loads.
PART_HZ, PART_SHARE, NO_PART = (1.2, 1.5, 1.9, 2.4, 3.0, 3.8), 0.25, 0.7
#: More than this unexplained and nothing is said: friction, stops, or sensors that are wrong.
HOPELESS = 0.35
#: Inertias are found within a third, those of a short tractor within a half, where they are surer than this.
INERTIA_OFF, SURE = 1.6, 4.0
#: About the hinge the mass counts too: it must be off by this, and freeing it must explain this share more.
HINGE_OFF, BETTER = 0.05, 0.9
#: Of inertia and centre of gravity, the one that leaves this share more unexplained is not the cause.
WORSE = 1.15
#: Centres of gravity are found within 3 % of the wheelbase of a single body, 8 % of coupled ones.
CENTRE_OFF, CENTRE_OFF_COUPLED = 0.05, 0.09
_CLEAR_M = 0.2


def mass_complaints(campaign: Campaign, spectra: Sequence[RunSpectra], unclear: bool = False) -> list[str]:
    """Sentences about load cases, inertias and axle loads.

    Parameters
    ----------
    spectra
        Those of the runs that tell all motions of the frames.
    unclear
        Whether what is declared cannot be right, so that inertias and centres of gravity are not compared with it.
    """
    if not spectra:
        return []
    by_case: dict[str, list[RunSpectra]] = {}
    for run in spectra:
        by_case.setdefault(run.load_case, []).append(run)
    copied = _copied_loads({name: campaign.load_cases[name] for name in by_case})
    if copied:
        return copied
    wrong = _wrong_load_cases(campaign, spectra)
    if wrong or unclear:
        return wrong
    said: dict[str, list[str]] = {}
    for name, runs in by_case.items():
        for sentence in _of_load_case(campaign.vehicle, campaign.load_cases[name], runs):
            said.setdefault(sentence, []).append(name)
    return [f"Load case {' and '.join(repr(shorten(n)) for n in names)}: {text}" for text, names in said.items()]


def _copied_loads(cases: Mapping[str, LoadCase]) -> list[str]:
    """Load cases with the same readings of the scale at every axle, which no two weighings give."""
    return [
        f"The load cases '{shorten(one)}' and '{shorten(two)}' have the same axle_loads_kg: the readings of one are "
        "probably copied. Give each its own readings, and its own sprung_mass_kg."
        for one, two in combinations(cases, 2)
        if cases[one].axle_loads_kg == cases[two].axle_loads_kg
    ]


def _other_loads(vehicle: Vehicle, load_case: LoadCase) -> dict[str, LoadCase]:
    """The load case as it would be if its axle loads were listed or weighed wrongly, by what is then said."""
    loads = load_case.axle_loads_kg
    unsprung = [sum(a.unsprung_mass_kg for a in vehicle.axles if a.body == b) for b in range(len(vehicle.bodies))]
    doubled = tuple(2.0 * m + u for m, u in zip(load_case.sprung_mass_kg, unsprung, strict=True))
    return {
        "the frames move as with axle_loads_kg in the opposite order, so they are probably listed from the rear; list "
        "them from front to rear, like the axles": replace(load_case, axle_loads_kg=loads[::-1]),
        "the frames move as with twice the axle_loads_kg, so these are probably readings of one side; give the sums of "
        "both sides, and sprung_mass_kg to match": replace(
            load_case, axle_loads_kg=tuple(2.0 * m for m in loads), sprung_mass_kg=doubled
        ),
    }


def _solved(
    runs: Sequence[RunSpectra],
    vehicle: Vehicle,
    load_case: LoadCase,
    free: str | None = None,
    part: OwnSprings | None = None,
) -> Balance | None:
    try:
        return balance(runs, vehicle, [load_case] * len(runs), free, part)
    except CampaignError:
        return None


def _wrong_load_cases(campaign: Campaign, spectra: Sequence[RunSpectra]) -> list[str]:
    """Runs that another load case explains better, while what may be wrong with the masses does not."""
    vehicle, cases = campaign.vehicle, campaign.load_cases
    if len(cases) < 2:
        return []
    gains: dict[str, tuple[float, str]] = {}
    for run in spectra:
        declared = _solved([run], vehicle, cases[run.load_case])
        if declared is None:
            continue
        others = {n: f for n in cases if n != run.load_case and (f := _solved([run], vehicle, cases[n])) is not None}
        if not others:
            continue
        best = min(others, key=lambda n: others[n].unexplained)
        freed = [
            f.unexplained
            for free in ("inertia", "moment")
            if (f := _solved([run], vehicle, cases[run.load_case], free))
        ]
        listed_wrongly = [
            f.unexplained
            for case in _other_loads(vehicle, cases[run.load_case]).values()
            if (f := _solved([run], vehicle, case)) and np.all(f.stiffness > 0.0)
        ]
        # Masses with which a spring would have to push the wrong way are not those of the run.
        if others[best].unexplained > HOPELESS or np.any(others[best].stiffness < 0.0):
            gains[run.file] = (1.0, best)
            continue
        # Freeing an inertia explains a little more in any case; much more than another load case means that it is that.
        ratio = others[best].unexplained / declared.unexplained
        instead = FREED_SURELY if _makes_sense_instead(declared, others[best]) else FREED_INSTEAD
        if freed and min(freed) < instead * others[best].unexplained:
            ratio = 1.0
        # Nothing is free here, so that the better one is the likelier one.
        if listed_wrongly and min(listed_wrongly) < others[best].unexplained:
            ratio = 1.0
        gains[run.file] = (ratio, best)
    wrong = [file for file, (ratio, _) in gains.items() if ratio < OTHER_CASE]
    if not wrong:
        return []
    if len(wrong) > 0.5 * len(gains) and float(np.median([r for r, _ in gains.values()])) < ALL_CASES:
        return [
            f"The load cases of the bump runs seem exchanged: the frames of {len(wrong)} of {len(gains)} runs move as "
            f"with the masses of another load case ({shorten(wrong[0], 60)} as '{shorten(gains[wrong[0]][1])}'). "
            "Correct load_case in tests.bump_run, or the tables of the load cases."
        ]
    listed = {run.file: run.load_case for run in spectra}
    # Its axles are as stiff as those of the other runs of its load case, unless it is none of them.
    stiffness = {(r.file, n): f.stiffness for r in spectra for n in cases if (f := _solved([r], vehicle, cases[n]))}
    wrong = [
        file
        for file in wrong
        if _unlike(file, gains[file][1], listed, stiffness) < _unlike(file, listed[file], listed, stiffness)
    ]
    return [
        f"{file}: the frames move as with the masses of the load case '{shorten(gains[file][1])}', not of "
        f"'{shorten(listed[file])}'; correct its load_case in tests.bump_run, or check that this is its log."
        for file in wrong
    ]


def _unlike(
    file: str, load_case: str, listed: Mapping[str, str], stiffness: Mapping[tuple[str, str], np.ndarray]
) -> float:
    """Mean departure of the logs of a run's stiffnesses in a load case from those of the runs listed under it."""
    others = [k for (other, name), k in stiffness.items() if name == load_case == listed[other] and other != file]
    own = stiffness.get((file, load_case))
    if own is None or np.any(own <= 0.0):
        return np.inf
    if not others or np.any(np.median(others, axis=0) <= 0.0):
        # Nothing to compare with: either is as good.
        return 0.0 if load_case != listed[file] else np.inf
    return float(np.mean(np.abs(np.log(own / np.median(others, axis=0)))))


def _makes_sense_instead(declared: Balance, other: Balance) -> bool:
    """Whether all stiffnesses are positive with the other masses, and not with the declared ones."""
    return bool(np.all(other.stiffness > 0.0) and not np.all(declared.stiffness > 0.0))


def _of_load_case(vehicle: Vehicle, load_case: LoadCase, runs: Sequence[RunSpectra]) -> list[str]:
    as_listed = _solved(runs, vehicle, load_case)
    inertia = _solved(runs, vehicle, load_case, "inertia")
    moment = _solved(runs, vehicle, load_case, "moment")
    if as_listed is None or inertia is None or moment is None:
        return []
    statics = static_equilibrium(vehicle, load_case)
    arms = statics.cg_x_m - np.array(hinges(vehicle))
    masses = np.array(load_case.sprung_mass_kg)
    declared = np.array(load_case.pitch_inertia_kg_m2)
    ratio = (inertia.freed * (declared + masses * arms**2) - masses * arms**2) / declared
    # An inertia of tons instead of kilograms leaves nothing to compare but the part about the centre of gravity.
    about_hinge = inertia.freed
    off = [
        b
        for b in range(masses.size)
        if not 1.0 / INERTIA_OFF < ratio[b] < INERTIA_OFF
        and abs(about_hinge[b] - 1.0) > max(HINGE_OFF, SURE * inertia.freed_se[b])
    ]
    turning = ""
    if off and inertia.unexplained < min(BETTER * as_listed.unexplained, HOPELESS):
        turning = "the frames turn as with pitch_inertia_kg_m2 of " + ", ".join(
            _inertia_words(vehicle, b, ratio[b] * declared[b], declared[b]) for b in off
        )
    centre = _centres(vehicle, load_case, as_listed, moment, arms)
    remedy = "check the inertias about the bodies' own centres of gravity, in kg m2."
    loads = _loads_instead(vehicle, load_case, runs, as_listed, min(inertia.unexplained, moment.unexplained))
    if loads:
        surely = loads[1] < 0.7 * inertia.unexplained or not turning
        return [f"{loads[0]}." if surely else f"either {loads[0]}; or {turning}: {remedy}"]
    if turning and centre and inertia.unexplained < WORSE * moment.unexplained < WORSE**2 * inertia.unexplained:
        return [f"either {centre}; or {turning}. Check axle_loads_kg, sprung_mass_kg and x_m, and {remedy}"]
    if turning and (not centre or inertia.unexplained < moment.unexplained):
        return [f"{turning}; {remedy}"]
    return [f"{centre}. Check axle_loads_kg, sprung_mass_kg and x_m."] if centre else []


def _loads_instead(
    vehicle: Vehicle, load_case: LoadCase, runs: Sequence[RunSpectra], as_listed: Balance, freed: float
) -> tuple[str, float] | None:
    """What is wrong with the axle loads as a whole if that explains the motion, and what it leaves unexplained.

    `freed` is what remains unexplained where an inertia or a centre of gravity is free.
    """
    found = {said: f for said, c in _other_loads(vehicle, load_case).items() if (f := _solved(runs, vehicle, c))}
    enough = min(OTHER_LOADS * as_listed.unexplained, AS_GOOD * freed, HOPELESS)
    good = {said: f.unexplained for said, f in found.items() if f.unexplained < enough and np.all(f.stiffness > 0.0)}
    if good and min(good.values()) > NO_PART * _with_a_part(vehicle, load_case, runs):
        return None
    return min(good.items(), key=lambda item: item[1]) if good else None


def _with_a_part(vehicle: Vehicle, load_case: LoadCase, runs: Sequence[RunSpectra]) -> float:
    """The least that remains unexplained where a part of the first body stands on springs of its own."""
    places = [axle.x_m for axle in vehicle.axles if axle.body == 0]
    found = [
        f.unexplained
        for x_m, hz in product(places, PART_HZ)
        if (f := _solved(runs, vehicle, load_case, part=OwnSprings(x_m, hz))) and 0.0 < f.freed[-1] < PART_SHARE
    ]
    return min(found, default=np.inf)


def _inertia_words(vehicle: Vehicle, body: int, explained: float, declared: float) -> str:
    about = f"about {explained:.2g}" if explained > 0.0 else "far less"
    return f"{about} for '{shorten(vehicle.bodies[body].name)}' (listed {declared:g})"


def _centres(vehicle: Vehicle, load_case: LoadCase, as_listed: Balance, moment: Balance, arms: np.ndarray) -> str:
    """Axle loads that put a centre of gravity where the frames do not turn about it."""
    if moment.unexplained > min(0.5 * as_listed.unexplained, HOPELESS):
        return ""
    away = (moment.freed - 1.0) * arms
    error = moment.freed_se * np.abs(arms)
    spans = _spans(vehicle)
    share = CENTRE_OFF if len(spans) == 1 else CENTRE_OFF_COUPLED
    off = [b for b in range(arms.size) if abs(away[b]) > max(share * spans[b], _CLEAR_M, 4.0 * error[b])]
    if not off:
        return ""
    said = ", ".join(
        f"{abs(away[b]):.2f} m {'behind' if away[b] > 0 else 'in front of'} the place of "
        f"'{shorten(vehicle.bodies[b].name)}' that the axle loads give"
        for b in off
    )
    pair = _exchanged(vehicle, load_case, away, error, spans)
    likely = ""
    if pair is not None:
        one, two = (shorten(vehicle.axles[i].name) for i in pair)
        likely = f"; exchanging the loads of '{one}' and '{two}' would explain it"
    return f"the centre of gravity is {said}{likely}"


def _spans(vehicle: Vehicle) -> list[float]:
    """Distance between the outermost supports of every body [m]."""
    spans = []
    for b, body in enumerate(vehicle.bodies):
        places = [a.x_m for a in vehicle.axles if a.body == b]
        places += [body.hitch_x_m] if body.hitch_x_m is not None else []
        spans.append(max(places) - min(places))
    return spans


def _exchanged(
    vehicle: Vehicle, load_case: LoadCase, away: np.ndarray, error: np.ndarray, spans: Sequence[float]
) -> tuple[int, int] | None:
    """The two axles whose loads, exchanged, put the centres of gravity nearest to where they are."""
    before = static_equilibrium(vehicle, load_case).cg_x_m
    loads = load_case.axle_loads_kg
    scale = np.maximum(error, 0.04 * np.array(spans))
    best: tuple[float, tuple[int, int]] | None = None
    for i, j in combinations(range(len(loads)), 2):
        order = list(range(len(loads)))
        order[i], order[j] = j, i
        try:
            after = static_equilibrium(vehicle, replace(load_case, axle_loads_kg=tuple(loads[k] for k in order))).cg_x_m
        except CampaignError:
            continue
        misfit = float(np.sum(((after - before - away) / scale) ** 2))
        if best is None or misfit < best[0]:
            best = (misfit, (i, j))
    left = float(np.sum((away / scale) ** 2))
    return best[1] if best is not None and best[0] < 0.3 * left else None


def stiffness_of(spectra: Sequence[RunSpectra], campaign: Campaign, name: str) -> Balance | None:
    """k and c of all axles from the runs of one load case."""
    runs = [run for run in spectra if run.load_case == name]
    return _solved(runs, campaign.vehicle, campaign.load_cases[name]) if runs else None
