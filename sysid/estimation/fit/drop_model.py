"""Plank drops fitted by the full vehicle model: coupling of the axles, tires and pitch included.

A drop becomes a run over a road that only the axle under test meets: the end of a plank.  The residuals, weights and
the minimisation are those of the bump runs; all drops share one set of parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from sysid.arrays import Samples
from sysid.campaign.records import BumpRun, Campaign, Channel, PlankDrop
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import DataRejectedError, SysidError
from sysid.estimation.fit.optimum import Optimum, parameter_sd
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.reweighted_search import optimise_from
from sysid.estimation.fit.start_search import InGroup, Record, best_shifts
from sysid.estimation.parameters.campaign_parameters import (
    DOUBTFUL_DAMPING_SD,
    DOUBTFUL_STIFFNESS_SD,
    campaign_parameters,
)
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.progress import Progress, Series, unwatched
from sysid.road.enveloping import FootprintMap, footprint_map
from sysid.road.plank_road import lifted_onto_plank, plank_table
from sysid.sdof.drop_results import DropAnalysis, DropEstimate, DropSummary
from sysid.sdof.settings import DropSettings
from sysid.sdof.smoothing import high_frequency_noise, local_polynomial, robust_sd
from sysid.vehicle_model.passes import EffectiveRoads

#: Time before the record [s] in which the simulated axle is lifted onto the plank, and how long it then rests.
LEAD_S = 3.0
REST_S = 1.2
#: Speed of a drop without a declared one: 0.5 to 3 m/s, walking pace, is the 95 % range of a lognormal about this
#: median (an assumption).
SPEED_M_S = 1.2
SPEED_LOG_SD = 0.45
_SPEEDS = np.geomspace(0.5, 3.5, 10)
_FINER = np.array([0.86, 0.93, 1.07, 1.15])
#: Residual over instrument noise from which on the estimates carry a note.
DOUBT = 1.6
#: How long after its release a record is fitted [s]: a truck at rest gives no more information.
_FIT_S = 3.0
#: Margin to the release and share of the record at its end that is at rest, and fewest readings of a rest.
_REST_MARGIN_S, _REST_SHARE, _REST_READINGS = 0.05, 0.2, 20
#: Half window of the smoothing that tells noise from what is left of the body's motion, some 8 Hz and less [s].
_SLOW_S = 0.1
#: Distance at which the end of the plank begins to affect a wheel [m], and possible error of the instant [s].
FOOT_M = 0.15
SLACK_S = 0.3

#: Roads begin at a multiple of this before the end of the plank. So at usual speeds all have one length, for which the
#: reference engine is compiled once.
_WHOLE_M = 13.0

#: Iterations of the first search of the drops, and how many times :data:`DOUBT` its residuals have to be to end there
#: when it has not converged.
_FIRST_ITERATIONS, _CLEARLY = 15, 2.0

_BODIES_ONLY = "The full model fits wheels that roll off a plank, not bodies that are let go: no estimates by it here."


@dataclass(frozen=True)
class _Lift:
    """Road of one drop: the axle on the plank, its height and where the simulated axle is lifted onto it [m]."""

    axle: int
    height_m: float
    raised_m: tuple[float, float]


class PlankRoads(EffectiveRoads):
    """Footprint maps of drops by name: the end of a plank under one axle, flat road under all others."""

    def __init__(self, vehicle: Vehicle, load_cases: dict[str, LoadCase]):
        super().__init__(vehicle, load_cases, {})
        self._lifts: dict[str, _Lift] = {}
        self._table = lru_cache(maxsize=None)(plank_table)
        self._end = lru_cache(maxsize=None)(self._make_end)

    def _make_end(self, load_case: str, number: int, height_m: float) -> FootprintMap:
        axle, gravity = self.vehicle.axles[number], self.vehicle.gravity_m_s2
        first = next(iter(self.load_cases.values()))
        return footprint_map(
            self._table(height_m, axle.tire_radius_m),
            self.load_cases[load_case].axle_loads_kg[number] * gravity,
            first.axle_loads_kg[number] * gravity,
            axle.tire_stiffness_N_per_m,
        )

    def place(self, name: str, lift: _Lift) -> None:
        """Say what the road of a drop is."""
        self._lifts[name] = lift

    def maps(self, load_case: str, bump: str, run: str = "") -> tuple[FootprintMap, ...]:
        """Footprint map of every axle in a load case for one drop."""
        lift = self._lifts[bump]
        end = self._end(load_case, lift.axle, round(lift.height_m, 6))
        under = lifted_onto_plank(end, lift.raised_m)
        length = np.ceil(-under.station_m[0] / _WHOLE_M) * _WHOLE_M
        under = under.widened(round(-length / under.step_m), round(under.station_m[-1] / under.step_m))
        flat = replace(
            under,
            rise_m=np.zeros_like(under.rise_m),
            stretch=np.zeros_like(under.stretch),
            drag=np.zeros_like(under.drag),
            lift_m=np.zeros_like(under.lift_m),
        )
        return tuple(under if i == lift.axle else flat for i in range(len(self.vehicle.axles)))


def with_model_estimates(
    campaign: Campaign, drops: DropSummary, options: FitOptions, progress: Progress | None = None
) -> DropSummary:
    """The drop analysis with the full model's estimates added to the single-axle ones; a failure becomes a message.

    If the fit fails numerically, only its own estimates are missing; the other results of the drops are kept.
    """
    if not any(e.usable for e in drops.pooled):
        return drops
    if (left_out := sum(d.release == "body" for d in campaign.plank_drops)) == len(campaign.plank_drops):
        return replace(drops, messages=(*drops.messages, _BODIES_ONLY))
    said = () if not left_out else (f"The full model leaves out {left_out} drops of a body that was let go.",)
    try:
        estimates = fit_drops(campaign, drops, options, progress)
    except (SysidError, ArithmeticError, ValueError, RuntimeError) as error:
        # LinAlgError is a ValueError, JAX's and optimistix's errors are RuntimeErrors.
        why = _reason(error)
        return replace(drops, messages=(*drops.messages, *said, f"The drops were not fitted by the full model: {why}"))
    finite = tuple(e for e in estimates if np.all(np.isfinite([e.stiffness, e.damping, e.stiffness_sd, e.damping_sd])))
    if len(finite) < len(estimates):
        said = (*said, "The full model gave no finite numbers for some axles; the readings of the drops stand.")
    return replace(drops, pooled=(*finite, *drops.pooled), messages=(*drops.messages, *said))


def _reason(error: Exception) -> str:
    """Why a fit failed, in one sentence."""
    if isinstance(error, SysidError):
        return str(error)
    first = " ".join(str(error).split())[:120].rstrip(".") or type(error).__name__
    return f"its least squares broke down ({first}); the readings above are not touched by that."


def fit_drops(
    campaign: Campaign,
    drops: DropSummary,
    options: FitOptions | None = None,
    progress: Progress | None = None,
) -> tuple[DropEstimate, ...]:
    """Stiffness and damping of every axle that was dropped, by least squares of the full model on all drops at once.

    Each drop's speed (declared, else 0.5 to 3 m/s) and the moment at which its wheel passes the end of the plank are
    estimated with the parameters. Drops with the dampers removed, and drops of lifted bodies, are left out.

    Parameters
    ----------
    campaign : screened campaign; at least one of its plank drops must have been usable in `drops`.
    drops : the drop analysis, for start values.
    options, progress : settings of the least squares, and a callback (message, fraction done).

    Returns
    -------
    Estimates with method ``model``, one per axle (of a group at its first axle) and load case of its stiffness.
    Standard deviations include what the model does not explain (residual over instrument noise), the tolerance of the
    masses, and by how much linear laws err in the single-axle fits of the same records. If the residual is large, they
    also include the spread that linear laws leave on vehicles with dry friction.

    Raises
    ------
    DataRejectedError
        If no plank drop can be used.
    """
    options = options or FitOptions()
    report = Series(progress or unwatched, 0.4)
    analysed = {a.file: a for a in drops.files if np.isfinite(a.release_time_s)}
    records = [d for d in campaign.plank_drops if d.dampers and d.log.file in analysed and d.release == "plank"]
    if not records:
        raise DataRejectedError("No plank drop can be fitted: none with its dampers in place shows a release.")
    roads = PlankRoads(campaign.vehicle, dict(campaign.load_cases))
    runs = tuple(_as_run(i, d, _last_time(analysed[d.log.file])) for i, d in enumerate(records))
    released = np.array([analysed[d.log.file].release_time_s for d in records])
    noise = [_noise(d, r) for d, r in zip(records, released, strict=True)]
    as_runs = replace(campaign, bump_runs=runs, predictions=())
    parameters = campaign_parameters(as_runs, drops)
    report("searching speeds and releases of the drops", 0.05)

    def model_at(speeds: np.ndarray, starts: np.ndarray) -> BumpModel:
        for run, drop, speed, start in zip(runs, records, speeds, starts, strict=True):
            reach = (-speed * (start - 0.15), -speed * (start - LEAD_S + REST_S))
            roads.place(run.bump, _Lift(drop.axle, drop.plank_height_m or 0.0, reach))
        model = bump_model(as_runs, parameters, {}, target_step_s=2.0 * options.target_step_s, roads=roads)
        # A drop's start is the moment of the axle under test, not of axle 1.
        return replace(model, arrays=tuple(a._replace(axle_x=np.zeros_like(a.axle_x)) for a in model.arrays))

    motion = _search(runs, released + LEAD_S, parameters.start, model_at, noise)
    model = model_at(motion.speed_m_s, motion.start_s)
    instrument = _instrument_noise(model, noise)
    report("fitting the plank drops with the full model", 0.2)
    # A short search shows whether linear laws suit the drops.
    short = options.phase(weight_rounds=1, tolerance=1e-3, max_iterations=_FIRST_ITERATIONS, larger_steps=True)
    optimum = optimise_from(as_runs, model, motion, instrument, parameters.start, short, report)
    if not _says_little(optimum):
        values, motion = optimum.problem.unpack(optimum.vector)
        search = partial(optimise_from, as_runs, model, motion, instrument, values, options.phase(), report)
        optimum = search(weights=optimum.problem.weights, damping=optimum.minimum.damping)
    return _estimates(records, optimum, list(analysed.values()))


def _says_little(optimum: Optimum) -> bool:
    """Whether linear laws leave such large residuals that the estimates have little value, even after a long search.

    For a search that has not converged, the residuals must be clearly too large.
    """
    return optimum.misfit >= (DOUBT if optimum.minimum.converged else _CLEARLY * DOUBT)


def _as_run(number: int, drop: PlankDrop, last_s: float) -> BumpRun:
    """A drop as a run: readings shifted by the lead, sensors named by their axle, the tail after `last_s` left out."""
    channels = []
    for channel in drop.log.channels:
        keep = channel.time_s <= last_s
        if not keep.any():
            # A clock of its own that begins later.
            continue
        sensor = replace(channel.sensor, column=_column(channel, drop))
        channels.append(Channel(sensor, channel.time_s[keep] + LEAD_S, channel.value[keep], channel.censored[keep]))
    declared = drop.nominal_speed_m_s
    return BumpRun(
        case=f"drop of axle {drop.axle + 1}",
        load_case=drop.load_case,
        nominal_speed_m_s=declared or SPEED_M_S,
        repeat=number + 1,
        log=replace(drop.log, channels=tuple(channels)),
        bump=f"drop {number + 1}",
        speed_sd=0.1 if declared else SPEED_LOG_SD,
        speed_change_sd=0.0,
    )


def _column(channel: Channel, drop: PlankDrop) -> str:
    return f"{channel.sensor.column} of axle {drop.axle + 1}"


def _last_time(analysis: DropAnalysis) -> float:
    """End of the fitted part [s]: some seconds after the release, or a second drop in the same file."""
    return float(np.fmin(analysis.release_time_s + _FIT_S, analysis.second_drop_s))


def _search(
    runs: Sequence[BumpRun],
    released_s: np.ndarray,
    start: np.ndarray,
    model_at: Callable[[np.ndarray, np.ndarray], BumpModel],
    noise: Sequence[dict[str, float]],
) -> RunMotion:
    """Speed and start of every drop: the best of a geometric list of speeds, each with its best shift in time.

    Parameters
    ----------
    released_s : when each record begins to move [s]; the wheel's centre passes the end of the plank a little later.
    start : (p,) log parameters.
    noise : of every drop, as from `_noise`.
    """
    count = len(runs)
    nominal = np.array([r.expected_speed_m_s for r in runs])
    reach = np.array([r.speed_sd for r in runs])
    best = np.full(count, np.inf)
    speed, begin = nominal.copy(), released_s.copy()
    # The same for every trial: these change the road alone.
    records: dict[InGroup, Record] = {}
    reach_samples: dict[InGroup, tuple[float, float]] = {}

    def trial(speeds: np.ndarray) -> None:
        starts = released_s + FOOT_M / speeds
        model = model_at(speeds, starts)
        signals = simulate_runs(model, start, RunMotion.steady(speeds, starts))
        if not records:
            sd = _instrument_noise(model, noise)
            for k, group in enumerate(model.groups):
                samples = SLACK_S / group.interval_s
                for r in range(len(group.runs)):
                    records[k, r], reach_samples[k, r] = Record(group, r, sd[k][r]), (-samples, samples)
        for (k, r), (misfit, shift) in best_shifts(records, signals, reach_samples).items():
            run = model.groups[k].runs[r]
            cost = misfit + float(((speeds[run] / nominal[run] - 1.0) / reach[run]) ** 2)
            if cost < best[run]:
                best[run], speed[run] = cost, speeds[run]
                begin[run] = starts[run] + shift * model.groups[k].interval_s

    for factor in _SPEEDS / SPEED_M_S:
        trial(nominal * np.where(reach > 0.2, factor, 1.0 + (factor - 1.0) * 0.1))
    for factor in _FINER:
        trial(speed * factor)
    return RunMotion.steady(speed, begin)


def _instrument_noise(model: BumpModel, noise: Sequence[dict[str, float]]) -> tuple[np.ndarray, ...]:
    """Noise (R, C) of the groups of runs, infinite where a drop has no such channel."""
    columns = [s.column for s in model.layout.sensors]
    return tuple(np.array([[noise[run].get(c, np.inf) for c in columns] for run in g.runs]) for g in model.groups)


def _noise(drop: PlankDrop, released_s: float) -> dict[str, float]:
    """Noise of the channels of a drop by their columns as a run; channels with fewer than eight readings left out."""
    noise = {}
    for channel in drop.log.channels:
        good = np.isfinite(channel.value)
        time, value = channel.time_s[good], channel.value[good]
        if value.size >= 8:
            # Fast differences see little of a noise that the filter of the logger has smoothed.
            largest = max(high_frequency_noise(value), _scatter_at_rest(time, value, released_s))
            noise[_column(channel, drop)] = max(largest, 1e-3 * float(np.std(value)) + 1e-9)
    return noise


def _scatter_at_rest(time_s: Samples, value: Samples, released_s: float) -> float:
    """Scatter about the slow motion before the release or at the end, where it is less; 0 without such readings."""
    end = max(released_s + _FIT_S, time_s[-1] - _REST_SHARE * (time_s[-1] - time_s[0]))
    scatter = []
    for part in (time_s < released_s - _REST_MARGIN_S, time_s >= end):
        t, y = time_s[part], value[part]
        if y.size >= _REST_READINGS:
            fast = y - local_polynomial(t, y, t, _SLOW_S)[0]
            scatter.append(robust_sd(fast[np.isfinite(fast)]))
    return min(scatter, default=0.0)


def _form_sd(analysed: Sequence[DropAnalysis], axle: int, load_case: str) -> np.ndarray:
    """Relative standard deviations (2,) of k and c from what the full model takes as given.

    Its masses are those of the scales, and its laws are linear: the second part is by how much linear laws err in the
    single-axle fits of the same records.
    """
    bias = [a.fit.linear_bias for a in analysed if a.fit is not None and (a.axle, a.load_case) == (axle, load_case)]
    of_laws = np.abs(np.mean(bias, axis=0)) if bias else np.zeros(2)
    return np.asarray(np.hypot(DropSettings().tributary_mass_tolerance, of_laws))


def _estimates(
    records: Sequence[PlankDrop], optimum: Optimum, analysed: Sequence[DropAnalysis]
) -> tuple[DropEstimate, ...]:
    parameters = optimum.problem.model.parameters
    sd = parameter_sd(optimum) * max(1.0, optimum.misfit)
    doubtful = optimum.misfit >= DOUBT
    doubt = np.array([DOUBTFUL_STIFFNESS_SD, DOUBTFUL_DAMPING_SD]) * doubtful
    note = (
        f"the model leaves {optimum.misfit:.1f} times the instrument noise, as with dry friction or dampers that are "
        "not linear: its standard deviations allow for that"
    )
    estimates = []
    # Drops of a group's axles give estimates of the same suspension.
    owner = parameters.suspension_axle
    dropped = {(owner[d.axle] if owner else d.axle, d.load_case) for d in records}
    for axle, load_case in sorted(dropped, key=lambda key: (key[1], key[0])):
        k, c = parameters.index("stiffness", axle, load_case), parameters.index("damping", axle, load_case)
        stiffness, damping = np.exp(optimum.vector[[k, c]])
        form = np.hypot(_form_sd(analysed, axle, load_case), doubt)
        estimates.append(
            DropEstimate(
                axle=axle,
                load_case=load_case,
                file=None,
                method="model",
                stiffness=float(stiffness),
                stiffness_sd=float(stiffness * np.hypot(sd[k], form[0])),
                damping=float(damping),
                damping_sd=float(damping * np.hypot(sd[c], form[1])),
                damped_period=float("nan"),
                log_decrement=float("nan"),
                # A slow search because linear laws do not suit is accepted as well.
                usable=bool(optimum.minimum.converged or doubtful),
                note=note if doubtful else "",
            )
        )
    return tuple(estimates)
