"""What everybody asks first of a calibration: k and c of every axle, the largest axle load, and whether to use them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.display import NOT_DETERMINED
from sysid.estimates.suspension_values import AxleEstimates, Estimate
from sysid.numbers import MISSING, decimals, fixed, speed
from sysid.prediction.quantiles import Quantiles
from sysid.results.contents import Judgement, Results, Trust
from sysid.results.pass_limits import pass_name

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction, SpeedSweep

#: An axle load at another speed is told from this multiple of the largest predicted one on.
_HIGHER = 1.05

_ANSWERS: dict[Trust, str] = {
    "use": "Yes",
    "use_within": "Yes, within limits",
    "do_not_bet": "Do not bet on them",
    "not_yet": "Not yet",
}


def answer_words(results: Results, judgement: Judgement) -> str:
    """Whether k, c and loads may be used, in a word or two."""
    return "Not for decisions" if results.status == "preview" else _ANSWERS[judgement.trust]


@dataclass(frozen=True)
class SuspensionRow:
    """Best stiffness and damping of an axle (index); `load_case` None where one value holds for all."""

    axle: int
    load_case: str | None
    stiffness: Estimate | None
    damping: Estimate | None


def suspension_rows(results: Results) -> tuple[SuspensionRow, ...]:
    """The most informed k and c of every axle, front to rear, one row per load case where they differ."""
    return paired_rows(results.suspension("stiffness"), results.suspension("damping"))


def paired_rows(stiffness: Sequence[AxleEstimates], damping: Sequence[AxleEstimates]) -> tuple[SuspensionRow, ...]:
    """Rows of :func:`suspension_rows` from the estimates of both quantities."""
    several = {row.axle for of in (stiffness, damping) for row in of if sum(r.axle == row.axle for r in of) > 1}
    rows = []
    for axle in sorted({row.axle for row in (*stiffness, *damping)}):
        of_axle = [r for r in (*stiffness, *damping) if r.axle == axle]
        cases = dict.fromkeys(r.load_case or r.drop_load_case for r in of_axle) if axle in several else {}
        # A value that all load cases share has a row of its own only where there is no other.
        for case in [c for c in cases if c is not None] or (None,):
            row = SuspensionRow(axle, case, _best(stiffness, axle, case), _best(damping, axle, case))
            if row.stiffness or row.damping:
                rows.append(row)
    return tuple(rows)


def _best(rows: Sequence[AxleEstimates], axle: int, case: str | None) -> Estimate | None:
    """The best estimate of an axle in a load case; one that is shared by all load cases counts in each."""
    of_axle = [r for r in rows if r.axle == axle]
    of_case = [r for r in of_axle if case is not None and case == (r.load_case or r.drop_load_case)]
    shared = [r for r in of_axle if r.load_case is None]
    for row in (*of_case, *shared, *(of_axle if case is None else ())):
        best: Estimate | None = row.best
        if best is not None:
            return best
    return None


def in_thousands(value: float, low: float | None = None, high: float | None = None) -> str:
    """A value in thousands of its unit, with half of its interval where the ends are known."""
    half = math.nan if low is None or high is None else (high - low) / 2e3
    places = decimals(value / 1e3, half)
    return fixed(value / 1e3, places) + (f" ± {fixed(half, places)}" if math.isfinite(half) else "")


def estimate_words(e: Estimate | None) -> str:
    """An estimate in kN/m or kN s/m with half of its interval, or the words for why there is no number."""
    if e is None or not math.isfinite(e.value):
        return MISSING
    return in_thousands(e.value, e.low, e.high) if e.identified else NOT_DETERMINED


@dataclass(frozen=True)
class PeakLoad:
    """The largest vertical load of an axle (index) in a pass, both sides together [N].

    `ratio` is it over `static_N`; `low_N`, `high_N` are the ends of its 90 % interval, None before sampling; `beyond`
    whether the pass goes beyond the driven runs at this axle.
    """

    axle: int
    load_case: str
    pass_name: str
    static_N: float
    ratio: float
    low_N: float | None
    high_N: float | None
    beyond: bool

    @property
    def peak_N(self) -> float:
        """Peak load [N]."""
        return self.ratio * self.static_N


def peak_loads(p: PassPrediction) -> tuple[PeakLoad, ...]:
    """Peak load of every axle in one pass, front to rear."""
    beyond = {e.axle for e in p.trust}
    ratio = Quantiles(p.peak_ratio_q05, p.peak_ratio_q50, p.peak_ratio_q95)
    return tuple(
        _peak_load(axle, p.load_case, pass_name(p), p.static_load_N, ratio, axle in beyond)
        for axle in range(len(p.static_load_N))
    )


def _peak_load(axle: int, load_case: str, name: str, static_N: np.ndarray, ratio: Quantiles, beyond: bool) -> PeakLoad:
    """Of the static loads and ratios of all axles in a pass, those of one."""
    static = float(static_N[axle])
    low, high = (None if q is None else static * float(q[axle]) for q in (ratio.q05, ratio.q95))
    return PeakLoad(axle, load_case, name, static, float(ratio.q50[axle]), low, high, beyond)


def largest_loads(results: Results) -> tuple[PeakLoad, ...]:
    """Of every axle the largest load of all predicted passes, front to rear; none before any is predicted."""
    passes = () if results.predictions is None else results.predictions.passes
    of_axles = zip(*(peak_loads(p) for p in passes), strict=True)
    return tuple(max(of_axle, key=lambda load: load.peak_N) for of_axle in of_axles)


def static_loads_N(results: Results, sweep: SpeedSweep) -> np.ndarray:
    """Static axle loads (axles,) [N] of a sweep's load case, from the scales."""
    kilograms = results.campaign.load_cases[sweep.load_case].axle_loads_kg
    return results.campaign.vehicle.gravity_m_s2 * np.asarray(kilograms, dtype=float)


def largest_at_any_speed(results: Results, *, as_driven: bool = False) -> tuple[PeakLoad | None, ...]:
    """Of every axle the largest load over the computed speeds of all load cases; none before sweeps.

    With `as_driven` only where nothing goes beyond the driven runs, None for an axle without such a speed.
    """
    sweeps = () if results.predictions is None else results.predictions.sweeps
    found: list[list[PeakLoad]] = [[] for _ in results.campaign.vehicle.axles] if sweeps else []
    for sweep in sweeps:
        static = static_loads_N(results, sweep)
        beyond = np.broadcast_to(np.asarray(sweep.extrapolated, bool)[:, None], sweep.peak_ratio.q50.shape)
        if sweep.beyond is not None:
            beyond = beyond | sweep.beyond
        ratio = np.where(np.isfinite(sweep.peak_ratio.q50) & ~(beyond & as_driven), sweep.peak_ratio.q50, 0.0)
        for axle, k in enumerate(ratio.argmax(axis=0)):
            name = f"{sweep.load_case}, {speed(float(sweep.speed_m_s[k]))}\u00a0km/h"
            if ratio[k, axle] > 0.0:
                at = sweep.peak_ratio.at(int(k))
                found[axle].append(_peak_load(axle, sweep.load_case, name, static, at, bool(beyond[k, axle])))
    return tuple(max(of_axle, key=lambda load: load.peak_N, default=None) for of_axle in found)


def _most(loads: Sequence[PeakLoad | None]) -> PeakLoad | None:
    return max((load for load in loads if load is not None), key=lambda load: load.peak_N, default=None)


def _largest_words(results: Results) -> tuple[str, str]:
    """The largest load that the driven runs back, and the largest of all where that is another one, a sentence each."""
    known = largest_loads(results)
    if not known:
        return "", ""
    most, elsewhere = max(known, key=lambda load: load.peak_N), _higher_elsewhere(results)
    if elsewhere is not None:
        # It stands in none of the requested passes.
        head, words, beyond = "Largest at any speed", _at_speed(elsewhere), elsewhere.beyond
    else:
        so, beyond = ", extrapolated" if most.beyond else "", most.beyond
        load = in_thousands(most.peak_N, most.low_N, most.high_N)
        head, words = "Largest", f"{load} kN on axle {most.axle + 1} ({most.pass_name}{so})"
    backed = _backed(results) if beyond else None
    if backed is None:
        return f"{head}: {words}.", ""
    load = in_thousands(backed.peak_N, backed.low_N, backed.high_N)
    driven = f"Largest as driven: {load} kN on axle {backed.axle + 1} ({backed.pass_name})"
    return f"{driven}.", f"Only computed: {words.replace(', extrapolated', '')}."


def _backed(results: Results) -> PeakLoad | None:
    """The largest load at a speed at which nothing goes beyond the driven runs."""
    return _most(largest_at_any_speed(results, as_driven=True))


def passes_beyond(results: Results) -> list[str]:
    """Names of passes whose loads are extrapolations: requested ones, and that of the largest load at any speed."""
    passes = () if results.predictions is None else results.predictions.passes
    beyond = [pass_name(p) for p in passes if p.trust]
    elsewhere = _higher_elsewhere(results)
    if beyond and elsewhere is not None and elsewhere.beyond and elsewhere.pass_name not in beyond:
        beyond.append(elsewhere.pass_name)
    return beyond


def _higher_elsewhere(results: Results) -> PeakLoad | None:
    known, most = largest_loads(results), _most(largest_at_any_speed(results))
    if not known or most is None:
        return None
    return most if most.peak_N > _HIGHER * max(load.peak_N for load in known) else None


def _at_speed(load: PeakLoad) -> str:
    so = ", extrapolated" if load.beyond else ""
    return f"{in_thousands(load.peak_N, load.low_N, load.high_N)} kN on axle {load.axle + 1} ({load.pass_name}{so})"


@dataclass(frozen=True)
class LoadsAnswer:
    """Whether predicted axle loads may be used, in a few words, the sentences for it, the largest load that was driven,
    and the largest that is only computed.
    """

    words: str
    sentences: str
    largest: str = ""
    computed: str = ""


def loads_answer(results: Results, judgement: Judgement) -> LoadsAnswer | None:
    """The answer for the loads of predicted passes; None before any."""
    passes = () if results.predictions is None else results.predictions.passes
    if not passes:
        return None
    beyond = sum(bool(p.trust) for p in passes)
    if judgement.trust not in ("use", "use_within") or results.status == "preview" or not beyond:
        return LoadsAnswer(answer_words(results, judgement), "", *(() if beyond else _largest_words(results)))
    driven = _driven(results)
    caution = "Loads marked * exceed these runs; their ± leaves out the error of extrapolating."
    if beyond == len(passes) and _backed(results):
        words = f"Yes, as driven ({driven}); else estimates only"
    else:
        words = "As estimates only" if beyond == len(passes) else "Yes, but for those marked *"
        caution = f"Driven: {driven}. {caution}"
    return LoadsAnswer(words, caution, *_largest_words(results))


def _driven(results: Results) -> str:
    """The speeds of the runs of every load case."""
    speeds: dict[str, list[float]] = {}
    for run in results.campaign.bump_runs:
        speeds.setdefault(run.load_case, []).append(run.nominal_speed_m_s)
    ranges = [
        f"{case} {' to '.join(dict.fromkeys(speed(v) for v in (min(of_case), max(of_case))))}"
        for case, of_case in speeds.items()
    ]
    return f"{', '.join(ranges)} km/h"
