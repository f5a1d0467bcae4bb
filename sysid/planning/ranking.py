"""Which run to drive next, and which sensor to add: what each would bring for k, c and a predicted axle load.

All candidates are judged at the optimum by the information that they would add
(:mod:`sysid.estimation.uncertainty.information`), with no new data: sd' = sqrt(diag(covariance(H + D))).  A predicted
peak r has the variance g' covariance g, g its gradient by the log parameters from central differences; the vehicle is
that of predicted passes: masses follow the parameters as the fit relates them, and assumed stops have median travels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.campaign.records import Campaign, PredictionRequest
from sysid.estimation.fit.state import FitState
from sysid.estimation.uncertainty.data_information import DataInformation
from sysid.estimation.uncertainty.identifiability import ROUGH, Identifiability, is_tire
from sysid.planning.advice_records import Advice, PeakTarget, Prospect
from sysid.planning.candidate_runs import (
    RunInformation,
    RunKind,
    missing_sensors,
    recording_sensors,
    run_information,
)
from sysid.prediction.driven_range import driven_range
from sysid.prediction.predict_passes import effective_roads, peak_ratios
from sysid.prediction.predicted_passes import Predictions
from sysid.prediction.trust import DrivenRange
from sysid.prediction.vehicle_draws import vehicles_of
from sysid.progress import Progress, unwatched
from sysid.wording import joined_words

#: Speeds of candidate runs [km/h].
CANDIDATE_KM_H = (8.0, 16.0, 24.0, 32.0)
#: Step of the log parameters in the gradient of a peak.
_STEP = 0.005
#: A further run that lowers a standard deviation by less than this share is not worth naming.
WORTH = 0.05
#: Mass properties shown, those that would bring most.
MASSES_SHOWN = 3
#: Tolerance of a mass that counts as known.
_EXACT = 1e-8


def advise(
    state: FitState,
    determined: Identifiability,
    *,
    speeds_km_h: Sequence[float] = CANDIDATE_KM_H,
    progress: Progress = unwatched,
    driven: DrivenRange | None = None,
    predictions: Predictions | None = None,
) -> Advice:
    """The benefit of one further run, with or without one further sensor.

    Parameters
    ----------
    state : the fit of the runs that were driven; determined : what they determine.
    speeds_km_h : speeds of the candidates, in every load case that was driven or is predicted, over every bump driven.
    driven : what the driven runs reached, None to compute it.
    predictions : of the passes of the campaign, whose median the peak has; None for the value at the optimum.
    """
    campaign = state.campaign
    progress("runs that could be driven next", 0.1)
    kinds = candidate_runs(campaign, speeds_km_h)
    at_hand, new = recording_sensors(state), missing_sensors(campaign, recording_sensors(state))
    candidates = run_information(state, kinds, (*at_hand, *new))
    progress("gradient of the predicted axle load", 0.7)
    target, gradient = None, None
    over_bumps = [k for k, request in enumerate(campaign.predictions) if request.over_bump]
    if over_bumps:
        first = over_bumps[0]
        known = None if predictions is None else predictions.passes[first].peak_ratio_q50
        target, gradient = peak_gradient(state, campaign.predictions[first], driven, known)
    information = determined.information

    def prospect(run: RunInformation | None, sensor: int | None = None) -> Prospect:
        sensors = at_hand if sensor is None else (*at_hand, new[sensor])
        return _prospect(information, gradient, run, None if run is None else run.of(sensors),
                         "" if sensor is None else new[sensor].column)  # fmt: skip

    now = prospect(None)
    runs = tuple(prospect(run) for run in candidates)
    with_sensors = [[prospect(run, k) for run in candidates] for k in range(len(new))]
    targets = tuple(p.name for p in state.model.parameters.parameters if p.quantity in ("stiffness", "damping"))
    bare = Advice(determined.names, targets, now, runs, (), target, ())
    best = tuple(min(row, key=bare.median) for row in with_sensors)
    all_sensors = [p for row in with_sensors for p in row]
    masses = exact_masses(bare, information, [f.words for f in state.allowances.masses.factors], gradient)
    statements = (
        _worst_statement(bare),
        *_mass_statements(bare, information, masses),
        *_run_statements(bare),
        *_sensor_statements(bare, all_sensors),
        *_remedies(bare, determined, all_sensors),
    )
    return Advice(determined.names, targets, now, runs, best, target, statements, masses)


def candidate_runs(campaign: Campaign, speeds_km_h: Sequence[float]) -> tuple[RunKind, ...]:
    """Every speed in every load case that was driven or is predicted, over every bump that was driven."""
    bumps = dict.fromkeys(r.bump for r in campaign.bump_runs)
    return tuple(
        RunKind(case, bump, v / 3.6) for case in campaign.load_cases_in_use for bump in bumps for v in speeds_km_h
    )


def peak_gradient(
    state: FitState,
    request: PredictionRequest,
    driven: DrivenRange | None = None,
    known: np.ndarray | None = None,
) -> tuple[PeakTarget, np.ndarray]:
    """The largest peak dynamic load ratio of a pass, and its gradient (p,) by the log parameters.

    Parameters
    ----------
    driven : what the driven runs reached, None to compute it; known : predicted ratios (axles,), None for those at the
        optimum.
    """
    point = state.point.log_parameters
    steps = _STEP * np.eye(point.size)
    sets = np.concatenate([point[None], point + steps, point - steps])
    roads = effective_roads(state, [request])
    vehicles, stops = vehicles_of(state, roads, sets, driven or driven_range(state))
    ratios = peak_ratios(state.campaign, state.parameters, roads, request, sets, vehicles, stops)
    predicted = ratios[0] if known is None else known
    axle = int(np.argmax(predicted))
    up, down = ratios[1 : point.size + 1, axle], ratios[point.size + 1 :, axle]
    target = PeakTarget(axle, request.load_case, request.speed_m_s, float(predicted[axle]))
    return target, (up - down) / (2.0 * _STEP)


def _prospect(
    information: DataInformation,
    gradient: np.ndarray | None,
    run: RunInformation | None,
    further: np.ndarray | None,
    sensor: str,
) -> Prospect:
    covariance = information.covariance(further)
    peak = float("nan") if gradient is None else float(np.sqrt(gradient @ covariance @ gradient))
    sd = np.sqrt(np.diag(covariance))
    if run is None:
        return Prospect("", "", float("nan"), "", sd, peak)
    return Prospect(run.kind.load_case, run.kind.bump, run.kind.speed_m_s, sensor, sd, peak)


def _percent(sd: float) -> str:
    return f"{100.0 * sd:.2g} %"


def _worst_statement(advice: Advice) -> str:
    name, sd = advice.worst(advice.now)
    best = min(advice.runs, key=lambda p: advice.worst(p)[1])
    then, left = advice.worst(best)
    start = f"Of k and c, {name} is known least well, with a standard deviation of {_percent(sd)}."
    if left < (1.0 - WORTH) * sd:
        other = "" if then == name else f" (then {then})"
        lower = f"One more run at {best.label} would lower the largest standard deviation to {_percent(left)}{other}."
        return f"{start} {lower}"
    return f"{start} No single further run with these sensors would lower it by {100.0 * WORTH:g} % or more."


def _run_statements(advice: Advice) -> list[str]:
    sentences = []
    middle = min(advice.runs, key=advice.median)
    if advice.median(middle) < (1.0 - WORTH) * advice.median(advice.now):
        sentences.append(
            f"The median standard deviation of k and c is {_percent(advice.median(advice.now))}. One more run at "
            f"{middle.label} would lower it most, to {_percent(advice.median(middle))}."
        )
    if advice.peak is not None:
        best = min(advice.runs, key=lambda p: p.peak_sd)
        text = f"The peak load ratio of {advice.peak.label} is {advice.peak.ratio:.2f} with a standard deviation of "
        text += f"{advice.now.peak_sd:.2g} from the parameters"
        if best.peak_sd < (1.0 - WORTH) * advice.now.peak_sd:
            text += f"; one more run at {best.label} would lower it most, to {best.peak_sd:.2g}"
        sentences.append(text + ".")
    return sentences


def exact_masses(
    advice: Advice, information: DataInformation, words: Sequence[str], gradient: np.ndarray | None
) -> tuple[Prospect, ...]:
    """What would be known without a further run if one declared mass property were exact, best first.

    Parameters
    ----------
    words : which property each tolerance of `information` belongs to.
    gradient : (p,) of the predicted peak, or None.
    """
    prospects = []
    for k, name in enumerate(words):
        known = np.where(np.arange(information.sd.size) == k, _EXACT, information.sd)
        one = _prospect(replace(information, sd=known), gradient, None, None, "")
        prospects.append(replace(one, exact=name))
    return tuple(sorted(prospects, key=lambda p: advice.worst(p)[1])[:MASSES_SHOWN])


def _mass_statements(advice: Advice, information: DataInformation, masses: Sequence[Prospect]) -> list[str]:
    """Which declared mass property limits what is known, where exact masses would lower the worst of k and c much."""
    if not masses:
        return []
    name, sd = advice.worst(advice.now)
    at = advice.names.index(name)
    exact = np.where(np.arange(information.sd.size) < information.masses, _EXACT, information.sd)
    all_exact = replace(information, sd=exact)
    left = float(np.sqrt(all_exact.covariance()[at, at]))
    if left > (1.0 - 4.0 * WORTH) * sd:
        return []
    best = min(masses, key=lambda p: p.sd[at])
    share = "Most" if left < 0.5 * sd else "Part"
    return [
        f"{share} of it comes from the tolerances of the declared masses. If all of them were exact, the standard "
        f"deviation of {name} would be {_percent(left)}; if only the {best.exact} were exact, "
        f"{_percent(float(best.sd[at]))}."
    ]


def _sensor_statements(advice: Advice, prospects: Sequence[Prospect]) -> list[str]:
    if not prospects:
        return ["Every axle has a deflection sensor, an accelerometer and an accelerometer on the frame above it."]
    best = min(prospects, key=lambda p: (advice.worst(p)[1], advice.median(p)))
    alone = min(advice.runs, key=lambda p: advice.worst(p)[1])
    if advice.worst(best)[1] >= (1.0 - WORTH) * advice.worst(alone)[1]:
        return [
            "No single further sensor, used in one run, would lower the largest standard deviation of k and c by "
            f"{100.0 * WORTH:g} % or more."
        ]
    name, sd = advice.worst(best)
    return [
        f"With one more sensor, an {best.sensor}, a run at {_without(best)} would lower the largest standard deviation "
        f"of k and c to {_percent(sd)} ({name})."
    ]


def _remedies(advice: Advice, determined: Identifiability, sensors: Sequence[Prospect]) -> list[str]:
    """The sensor and the run with most information about suspension parameters that are not well determined."""
    sentences = []
    weak = [g.names for g in determined.groups if not all(is_tire(name) for name in g.names)]
    said = {name for names in weak for name in names}
    rough = dict(zip(determined.names, determined.sd >= ROUGH, strict=True))
    weak += [(name,) for name in advice.targets if rough[name] and name not in said]
    for names in weak:
        at = [advice.names.index(name) for name in names]

        def left(p: Prospect, at: list[int] = at) -> float:
            return float(p.sd[at].max())

        now = left(advice.now)
        ways = []
        for word, prospects in (("add an", sensors), ("drive", advice.runs)):
            best = min(prospects, key=left, default=None)
            if best is None or left(best) >= (1.0 - WORTH) * now:
                continue
            what = f"{word} {best.sensor} and drive {_without(best)}" if best.sensor else f"{word} {best.label}"
            ways.append(f"{what} (to {_percent(left(best))})")
        text = f"{joined_words(names)}, now known to {_percent(now)}{' at worst' if len(names) > 1 else ''}: "
        sentences.append(text + (", or ".join(ways) if ways else "no single further run or sensor helps") + ".")
    return sentences


def _without(p: Prospect) -> str:
    return f"{3.6 * p.speed_m_s:.4g} km/h, {p.load_case}"
