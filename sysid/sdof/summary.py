"""All plank drops of a campaign: pooled estimates per axle, load case and method, and what limits them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict

import numpy as np
import pandas as pd

from sysid.campaign.records import Campaign, PlankDrop
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.helper_process import shared_with_helper
from sysid.progress import Progress, unwatched
from sysid.sdof.analysis import analyse_drop, axle_on_tire, has_neighbours
from sysid.sdof.averages import mean_with_scatter
from sysid.sdof.drop_results import DropAnalysis, DropEstimate, DropMethod, DropSummary
from sysid.sdof.estimates import AxleOnTire, invert, unusable
from sysid.sdof.settings import DropSettings
from sysid.wording import say_once

_NO_DEFLECTION = (
    "{}: the deflection of the axle under test is not declared in [sensors.plank_drop], or was rejected by the check, "
    "which says why; the drop is left out."
)

METHODS: tuple[DropMethod, ...] = ("paper", "corrected", "free_decay")


#: What the analysis of one drop is made of.
OfDrop = tuple[PlankDrop, Vehicle, LoadCase, DropSettings]


def analysed(drops: Sequence[OfDrop], done: Callable[[float], None]) -> tuple[DropAnalysis, ...]:
    """Analyses of drops by `analyse_drop`, each by itself.

    Parameters
    ----------
    done : callback (share of them that is done).
    """
    return shared_with_helper(_analysed, drops, done)


def analyse_drops(
    campaign: Campaign,
    settings: DropSettings | None = None,
    progress: Progress = unwatched,
    read: Callable[[Sequence[OfDrop], Callable[[float], None]], tuple[DropAnalysis, ...]] = analysed,
) -> DropSummary:
    """Analyse every plank drop of a campaign and pool the repeats.

    The pooled value is a weighted mean. The weights are from the variance of the reading plus the scatter between the
    repeats (`random_effects`), so its standard deviation includes that scatter. The tolerances of declared quantities
    are common to all repeats; they are added once and do not average out. Drops with the dampers removed are analysed
    but not pooled; drops without a usable deflection are left out.

    Parameters
    ----------
    campaign
        Records in SI units.
    settings
        Defaults of `DropSettings`.
    progress
        Callback (message, fraction done).
    read
        As `analysed`; another one may know some of the analyses already.

    Returns
    -------
    DropSummary
        One analysis per file, in the order of the campaign, pooled estimates (`file` None) by axle, load case, method.

    Raises
    ------
    DataRejectedError, CampaignError
        As `analyse_drop`.
    """
    settings = settings or DropSettings()
    vehicle = campaign.vehicle
    drops = [d for d in campaign.plank_drops if _shows_deflection(d)]
    work = [(d, vehicle, campaign.load_cases[d.load_case], settings) for d in drops]
    progress("readings of the drops", 0.0)
    files = read(work, lambda share: progress("readings of the drops", share))
    with_dampers = [a for a, d in zip(files, drops, strict=True) if d.dampers]
    pooled = []
    for axle, load_case in sorted({(a.axle, a.load_case) for a in with_dampers}, key=lambda key: (key[1], key[0])):
        group = [a for a in with_dampers if (a.axle, a.load_case) == (axle, load_case)]
        quarter_car = axle_on_tire(axle, vehicle, campaign.load_cases[load_case])
        pooled += [_pool(group, method, quarter_car, settings) for method in METHODS]
    without = [a for a, d in zip(files, drops, strict=True) if not d.dampers]
    messages = _messages(vehicle, files, pooled, without)
    hidden = [d.log.file for d in campaign.plank_drops if not _shows_deflection(d)]
    unseen = [(file, _NO_DEFLECTION.format(file)) for file in hidden]
    return DropSummary(files=files, pooled=tuple(pooled), messages=(*messages, *say_once(unseen)))


def _analysed(of_drop: OfDrop) -> DropAnalysis:
    return analyse_drop(*of_drop)


def _shows_deflection(drop: PlankDrop) -> bool:
    return any(
        c.sensor.kind == "suspension_deflection" and c.sensor.axle in (None, drop.axle) for c in drop.log.channels
    )


def summary_table(summary: DropSummary) -> pd.DataFrame:
    """All estimates as a table, pooled rows last: one row per axle, load case, file and method, SI units.

    Axles are counted from 1; columns as the fields of `DropEstimate`.
    """
    estimates = [e for a in summary.files for e in a.estimates] + list(summary.pooled)
    columns = list(DropEstimate.__dataclass_fields__)
    table = pd.DataFrame([asdict(e) for e in estimates], columns=columns)
    table["axle"] = table["axle"] + 1
    return table


def _pool(group: list[DropAnalysis], method: DropMethod, axle: AxleOnTire, settings: DropSettings) -> DropEstimate:
    """Mean of the usable repeats of one axle, load case and method."""
    rows = [(next(e for e in a.estimates if e.method == method), a) for a in group]
    usable = [(e, a) for e, a in rows if e.usable]
    if not usable:
        reasons = _distinct(e.note for e, _ in rows if e.note)
        return unusable(method, axle, None, f"none of {len(rows)} records usable: {'; '.join(reasons)}")
    used = [e for e, _ in usable]
    alike, said = _alike(used)
    of = {id(e): a for e, a in usable}
    values = {}
    for index, name in enumerate(("stiffness", "damping")):
        chosen = used if name == "stiffness" else alike
        value = np.array([getattr(e, name) for e in chosen])
        own, common = np.array([_variances(e, of[id(e)], axle, settings)[:, index] for e in chosen]).T
        mean, error = mean_with_scatter(value, np.diag(np.maximum(own - common, (1e-6 * value) ** 2 + 1e-12)))
        values[name], values[f"{name}_sd"] = mean, float(np.sqrt(error**2 + common.mean()))
    for name in ("friction_force", "quadratic_damping"):
        of_law = [e for e in alike if np.isfinite(getattr(e, name))]
        if of_law and 2 * len(of_law) >= len(alike):
            value, sd = (np.array([getattr(e, f"{name}{end}") for e in of_law]) for end in ("", "_sd"))
            mean, error = mean_with_scatter(value, np.diag(sd**2))
            # Declared masses are common to all repeats: no mean is known better than the best of them.
            values[name], values[f"{name}_sd"] = mean, max(error, float(sd.min()))
    notes = [*said, *_distinct(part for e in used for part in e.note.split("; ") if part)]
    if len(used) < len(rows):
        notes.insert(0, f"{len(used)} of {len(rows)} records usable")
    elif len(used) == 1:
        notes.insert(0, "one record only, nothing is known of the scatter between repeats")
    return DropEstimate(
        axle=axle.axle,
        load_case=axle.load_case,
        file=None,
        method=method,
        damped_period=float(np.mean([e.damped_period for e in used])),
        log_decrement=float(np.mean([e.log_decrement for e in used])),
        usable=True,
        note="; ".join(notes),
        damping_kind=Counter(e.damping_kind for e in alike).most_common(1)[0][0],
        **values,
    )


def _variances(e: DropEstimate, analysis: DropAnalysis, axle: AxleOnTire, settings: DropSettings) -> np.ndarray:
    """Variances of k and c of one record (2, 2): the whole, and what all repeats have in common."""
    if e.method == "free_decay" and analysis.fit is not None:
        return np.stack([np.diagonal(analysis.fit.covariance), analysis.fit.common_variance])
    whole, reading = np.square([e.stiffness_sd, e.damping_sd]), analysis.reading
    read = np.diag([reading.damped_period_se**2, reading.log_decrement_se**2])
    own = invert(e.method, axle, settings, e.damped_period, e.log_decrement, read).reading_covariance
    return np.stack([whole, np.maximum(whole - np.diagonal(own), 0.0)])


def _alike(usable: list[DropEstimate]) -> tuple[list[DropEstimate], list[str]]:
    """Repeats whose damping means the same (only viscous, or viscous with other damping), and a note on the others."""
    mixed = [e for e in usable if _more_than_viscous(e.damping_kind)]
    if not mixed or len(mixed) == len(usable):
        return usable, []
    alike = mixed if 2 * len(mixed) >= len(usable) else [e for e in usable if e not in mixed]
    which = "show" if alike is mixed else "do not show"
    return alike, [f"damping from the {len(alike)} of {len(usable)} records that {which} more than viscous damping"]


def _more_than_viscous(kind: str) -> bool:
    return "friction" in kind or "quadratic" in kind


def _distinct(sentences: Iterable[str]) -> list[str]:
    """Sentences that differ in more than their numbers, the first of each kind."""
    kinds: dict[str, str] = {}
    for sentence in sentences:
        kinds.setdefault(re.sub(r"[0-9.]+", "#", sentence), sentence)
    return list(kinds.values())


def _messages(
    vehicle: Vehicle, files: tuple[DropAnalysis, ...], pooled: list[DropEstimate], without_dampers: list[DropAnalysis]
) -> tuple[str, ...]:
    """Plain sentences about what the estimates can and cannot say."""
    messages = []
    if has_neighbours(vehicle) and files:
        messages.append(
            "Equations (1)-(3) take each axle for the only one under its body, but on this vehicle neighbouring axles "
            "and pitch share the motion that a plank drop shows. Stiffness and damping from drops are starting values, "
            "and the correction for the tire does not always improve them. The drops fitted with the full model "
            "(method model) do not have this error."
        )
    messages += [
        f"{a.file}: a second drop begins at {a.second_drop_s:.2f} s; the record is read up to there."
        for a in files
        if np.isfinite(a.second_drop_s)
    ]
    names = [axle.name for axle in vehicle.axles]
    unread = sorted({a.axle for a in files if _without_numbers(a)})
    for axle in unread:
        count = sum(_without_numbers(a) for a in files if a.axle == axle)
        total = sum(a.axle == axle for a in files)
        why = next(a.reading.note for a in files if a.axle == axle and _without_numbers(a))
        messages.append(f"Axle '{names[axle]}': {count} of {total} records give no two-peak decrement ({why}).")
    for axle in sorted({a.axle for a in files} - set(unread)):
        doubtful = [a for a in files if a.axle == axle and a.reading.log_decrement_se > 0.2 * a.reading.log_decrement]
        if doubtful:
            messages.append(
                f"Axle '{names[axle]}': the decrement of {len(doubtful)} records scatters by more than 20 %, its "
                "swings are not those of one mode; do not rely on the damping of methods paper and corrected."
            )
    messages += _friction_messages(names, files, pooled)
    for item in pooled:
        if item.method == "corrected" and "k/kt" in item.note:
            messages.append(
                f"Axle '{names[item.axle]}' ({item.load_case}): the corrected stiffness is above 0.4 of the tire's, "
                "where the correction amplifies every error; prefer the full model."
            )
    for analysis in without_dampers:
        messages.append(f"{analysis.file}: dampers removed, so it is not pooled with the other drops.")
    return tuple(messages)


def _without_numbers(analysis: DropAnalysis) -> bool:
    return not analysis.reading.usable


def _friction_messages(names: list[str], files: tuple[DropAnalysis, ...], pooled: list[DropEstimate]) -> list[str]:
    """One sentence per axle most of whose records show dry friction: how much, or that it could not be told apart."""
    messages = []
    for axle, load_case in sorted({(a.axle, a.load_case) for a in files}):
        group = [a for a in files if (a.axle, a.load_case) == (axle, load_case)]
        rubbing = sum("friction" in a.damping_kind for a in group)
        if 2 * rubbing <= len(group):
            continue
        of_axle = [e for e in pooled if (e.axle, e.load_case) == (axle, load_case) and np.isfinite(e.friction_force)]
        best = next(iter(of_axle), None)
        told = f"Axle '{names[axle]}' ({load_case}): {rubbing} of {len(group)} records show dry friction"
        if best is not None:
            force, sd = 1e-3 * best.friction_force, 1e-3 * best.friction_force_sd
            messages.append(
                f"{told} of {force:.2f} ± {sd:.2f} kN (method {best.method}); the damping coefficient is the viscous "
                "part beside it."
            )
        else:
            messages.append(
                f"{told}, the decrement rises as the amplitude falls; it could not be told apart from viscous damping, "
                "so the damping coefficient holds for the amplitudes of the drop only."
            )
    return messages
