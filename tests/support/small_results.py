"""Small synthetic results of every stage: two axles, two runs, three drops; closed forms and one seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sysid.balance.records import BalancedRecord, BalanceEstimate, ForceBalance, LawEstimate
from sysid.campaign.findings import ChannelFinding, QualityReport
from sysid.campaign.records import Acquisition, BumpRun, Campaign, Channel, Log, PlankDrop, PredictionRequest, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.estimates.derive import derive_estimates
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.profiles import ProfileLikelihood
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.estimation.residuals.run_history import HistoryBand, RunHistory
from sysid.estimation.uncertainty.data_information import DataInformation
from sysid.estimation.uncertainty.identifiability import assess
from sysid.estimation.weights.residual_evidence import ResidualEvidence
from sysid.planning.advice_records import Advice, PeakTarget, Prospect
from sysid.posterior.sampled_posterior import Posterior, PosteriorSummary
from sysid.prediction.predicted_passes import PassPrediction, Predictions, SpeedSweep
from sysid.prediction.quantiles import Quantiles
from sysid.prediction.trust import DrivenRange, Extrapolation
from sysid.results.contents import Results
from sysid.road.road_profile import ProfileIdentity, RoadProfile, ScanAnalysis
from sysid.sdof.drop_results import DecayReading, DropAnalysis, DropEstimate, DropSummary
from sysid.validation.channel_agreement import ChannelAgreement, Validation

PERIOD = 0.6
DECREMENT = 0.7
Z90 = 1.6448536269514722


@dataclass(frozen=True)
class Words:
    """Every piece of text that a user can choose; tests replace them by hostile ones."""

    title: str = "Small campaign"
    notes: str = "Two axles."
    vehicle: str = "short truck"
    front: str = "front axle"
    rear: str = "rear axle"
    empty: str = "empty"
    laden: str = "laden"
    case: str = "empty 20 km/h"
    drop_file: str = "drops/d{}.csv"
    run_file: str = "runs/r{}.csv"
    column: str = "sensor{}_mm"
    bump: str = "bump"
    message: str = "one remark"

    @classmethod
    def all(cls, text: str) -> Words:
        """The same text everywhere; numbered where names must differ."""
        numbered = text.replace("{", "{{").replace("}", "}}") + "{}"
        fields = dict.fromkeys(cls.__dataclass_fields__, text)
        fields |= {"drop_file": numbered, "run_file": numbered, "column": numbered}
        fields |= {"rear": text + " 2", "laden": text + " 2"}
        return cls(**fields)


def small_results(words: Words = Words(), **changes: object) -> Results:
    """Results of all stages; keyword arguments replace fields of `Results`."""
    w = words
    fit = small_fit(w)
    fit = replace(fit, histories=tuple(with_band(h) for h in fit.histories))
    fields: dict[str, object] = {
        "campaign": small_campaign(w),
        "quality": _quality(w),
        "drops": _drops(w),
        "balance": small_balance(w),
        "scans": {w.bump: _scan(w)},
        "fit": fit,
        "posterior": _posterior(fit),
        "predictions": _predictions(w),
        "driven": small_driven(w),
        "validation": _validation(w),
        "advice": small_advice(fit, w),
        "status": "converged",
        "warnings": (w.message,),
        "provenance": {
            "input_sha256": {w.run_file.format(1): "ab" * 32},
            "versions": {"sysid": "0.1.0", "emcee": "3.1.6"},
            "seed": 7,
            "settings": {"fit": {"step_s": 0.001}, "note": w.message},
            "timings": {"fit": 12.5, "sample": math.nan},
        },
    }
    return with_estimates(Results(**(fields | changes)))  # type: ignore[arg-type]


def small_balance(w: Words = Words()) -> ForceBalance:
    """k of the first axle by the force balance."""
    k = BalanceEstimate("k_1", "stiffness", 0, None, "N/m", 4.1e5, 3.9e5, 4.3e5, 0.03)
    law = LawEstimate("friction_share", 0, "1", 0.04, 0.01)
    record = BalancedRecord(w.run_file.format(1), w.empty, 6.5, 0.02)
    return ForceBalance((k,), (law,), (record,), (w.message,), True, 9)


def with_estimates(results: Results) -> Results:
    """The results with what follows from their drops, scans, fit and posterior."""
    r = results
    return replace(r, estimates=derive_estimates(r.campaign, r.drops, r.scans, r.fit, r.posterior))


def small_driven(w: Words = Words()) -> DrivenRange:
    """The rear axle was driven less hard than the predicted pass, the front axle harder."""
    far = {"tire_deflection_m": (0.08, 0.03), "jounce_m": (0.1, 0.05), "rebound_m": (0.1, 0.05)}
    far |= {"damper_speed_m_s": (2.0, 0.5), "lift_off_s": (0.1, 0.0)}
    return DrivenRange({w.empty: 48.0 / 3.6}, **{name: np.array(values) for name, values in far.items()})


def small_campaign(w: Words = Words()) -> Campaign:
    """Two axles on one body, two load cases, two runs with a deflection and an acceleration per axle."""
    axles = (
        Axle(w.front, 0, 0.0, 500.0, 1.6e6, 3e3, 0.5, "leaf"),
        Axle(w.rear, 0, 5.0, 900.0, 2.9e6, 3e3, 0.5, "air", load_dependent=True),
    )
    cases = {
        w.empty: LoadCase(w.empty, (4000.0, 3000.0), (5600.0,), (9e3,), (1.1,)),
        w.laden: LoadCase(w.laden, (5000.0, 9000.0), (12600.0,), (9e3,), (1.4,)),
    }
    time = np.arange(400) * 0.005
    sensors = _sensors(w)
    runs = []
    for i in (1, 2):
        channels = tuple(Channel(s, time, np.sin(9.0 * time), np.zeros(len(time), np.int8)) for s in sensors)
        runs.append(BumpRun(w.case, w.empty, 20.0 / 3.6, i, Log(w.run_file.format(i), 0.005, channels), w.bump))
    drops = tuple(
        PlankDrop(axle, w.empty, 0.075, Log(w.drop_file.format(i), 0.005, runs[0].log.channels[:1]))
        for i, axle in enumerate((0, 0, 1))
    )
    return Campaign(
        title=w.title,
        notes=w.notes,
        folder=Path("."),
        file=Path("campaign.toml"),
        vehicle=Vehicle(w.vehicle, (Body("body"),), axles),
        load_cases=cases,
        acquisition=Acquisition(0.005, None),
        plank_drops=drops,
        bump_runs=tuple(runs),
        scans={},
        predictions=(PredictionRequest(w.empty, 48.0 / 3.6, w.bump),),
        input_sha256={"campaign.toml": "cd" * 32},
    )


def _sensors(w: Words) -> tuple[Sensor, ...]:
    kinds = (("suspension_deflection", 0), ("suspension_deflection", 1), ("axle_acceleration", 0))
    return tuple(Sensor(w.column.format(i), kind, "mm", axle) for i, (kind, axle) in enumerate(kinds))  # type: ignore[arg-type]


def _quality(w: Words) -> QualityReport:
    def finding(i: int, verdict: str, noise: float | None) -> ChannelFinding:
        return ChannelFinding(
            w.run_file.format(1), w.column.format(i), "suspension_deflection", "m", 400, 200.0, 1e-5, 3, ((0.5, 3),),
            0, None, (), None, noise, 0.04, verdict, (w.message,),  # type: ignore[arg-type]
        )  # fmt: skip

    return QualityReport((finding(0, "good", 3e-4), finding(1, "rejected", None)), (w.message,))


def decaying_drop(w: Words = Words(), axle: int = 0, file: str = "d.csv", usable: bool = True) -> DropAnalysis:
    """An exact damped oscillation about 2 mm with amplitude 30 mm, its extrema where the cosine has them."""
    time = np.arange(1000) * 0.005
    sigma = DECREMENT / PERIOD
    release, level = 1.0, 2e-3
    since = time - release
    motion = 0.03 * np.exp(-sigma * since) * np.cos(2.0 * np.pi * since / PERIOD)
    trace = np.where(since >= 0.0, level + motion, level)
    when = release + PERIOD * np.arange(1, 6) / 2.0
    value = level + 0.03 * np.exp(-sigma * (when - release)) * np.array([-1.0, 1.0, -1.0, 1.0, -1.0])
    nan = math.nan
    reading = DecayReading(
        level, 1e-5, when, value, np.array([True, True, True, True, False]),
        PERIOD if usable else nan, 0.01, DECREMENT if usable else nan, 0.02, "viscous", 0.0, 0.1, usable,
        "" if usable else w.message,
    )  # fmt: skip
    estimates = tuple(
        DropEstimate(axle, w.empty, file, m, k if usable else nan, 5e3, c if usable else nan, 300.0, PERIOD, DECREMENT,
                     usable, "" if usable else w.message)
        for m, k, c in (("paper", 3.0e5, 7e3), ("corrected", 3.8e5, 9.5e3))
    )  # fmt: skip
    free_decay = np.where((since > 0.2) & (since < 2.0), trace, np.nan)
    return DropAnalysis(
        axle, w.empty, file, 3500.0, time, trace, trace, release, reading, free_decay, "", estimates,
        1.0 / PERIOD, DECREMENT / (2.0 * np.pi),
    )  # fmt: skip


def _drops(w: Words) -> DropSummary:
    files = tuple(
        decaying_drop(w, axle, w.drop_file.format(i), usable)
        for i, (axle, usable) in enumerate(((0, True), (0, True), (1, False)))
    )
    pooled = []
    for axle, usable in ((0, True), (1, False)):
        for method, k, c in (("paper", 3.0e5, 7e3), ("corrected", 3.8e5, 9.5e3)):
            value = (k, 4e3, c, 250.0) if usable else (math.nan,) * 4
            pooled.append(
                DropEstimate(
                    axle, w.empty, None, method, *value, PERIOD, DECREMENT, usable, "" if usable else w.message
                )  # type: ignore[arg-type]
            )
    return DropSummary(files, tuple(pooled), (w.message,))


def _scan(w: Words) -> ScanAnalysis:
    station = np.arange(0.0, 3.0, 0.01)
    height = np.where((station > 1.0) & (station < 2.0), 0.08 * np.sin(np.pi * (station - 1.0)) ** 2, 0.0)
    profile = RoadProfile(w.bump, station, height, np.full_like(station, 5e-4), 1.05, 0.9)
    across = np.linspace(-1.0, 1.0, len(station))
    return ScanAnalysis(
        profile, 0.1, 0.01, -0.02, 3000, 12, 2e-3, 0.3, station, height, station, across, height, (w.message,)
    )


def small_fit(w: Words = Words(), **changes: object) -> FitResult:
    """Stiffness shared on axle 1, per load case on axle 2; damping shared; a tire value that only the prior knows."""

    def parameter(name, quantity, axle, load_case, value, relative, unit, identified=True):
        return ParameterEstimate(
            name, quantity, unit, axle, load_case, None, "linear", "log", value, relative * value, 1.1 * value,
            1.2 * value, 0.4, identified,
        )  # fmt: skip

    parameters = (
        parameter("k_1", "stiffness", 0, None, 4.2e5, 0.01, "N/m"),
        parameter(f"k_2[{w.empty}]", "stiffness", 1, w.empty, 4.0e5, 0.02, "N/m"),
        parameter(f"k_2[{w.laden}]", "stiffness", 1, w.laden, 7.0e5, 0.02, "N/m"),
        parameter("c_1", "damping", 0, None, 1.1e4, 0.04, "N s/m"),
        parameter("c_2", "damping", 1, None, 9.0e3, 0.05, "N s/m"),
        parameter("kt_1", "tire_stiffness", 0, None, 1.6e6, 0.05, "N/m", identified=False),
    )
    file = w.run_file.format(1)
    runs = (
        ParameterEstimate(
            f"speed[{file}]", "speed", "m/s", None, w.empty, file, "", "linear", 5.6, 0.01, 5.5, 5.5, 0.1, True
        ),
    )
    relative = np.array([p.sd / p.value for p in parameters])
    correlation = np.full((6, 6), 0.3) + 0.7 * np.eye(6)
    covariance, prior = correlation * np.outer(relative, relative), np.eye(6) / 0.4**2
    information = DataInformation(np.linalg.inv(covariance) - prior, np.eye(6), prior, np.zeros(0), 0)
    lag = np.arange(20) * 0.005
    fields: dict[str, object] = {
        "parameters": parameters,
        "run_parameters": runs,
        "covariance": covariance,
        "identifiability": assess(parameters, covariance, information),
        "histories": tuple(small_history(w, i) for i in (1, 2)),
        "converged": True,
        "message": "the cost changes by less than 1e-10",
        "iterations": 12,
        "cost": 10.0,
        "residuals": 2400,
        "condition_number": 30.0,
        "step_halving_error": 2e-5,
        "scipy_max_difference_sd": 0.01,
        "variance_inflation": 3.0,
        "model_error_inflation": 4.0,
        "contact": "radial springs",
        "residual_evidence": small_evidence(lag),
        "warnings": (w.message,),
    }
    return FitResult(**(fields | changes))  # type: ignore[arg-type]


def small_evidence(lag: np.ndarray) -> ResidualEvidence:
    """Residuals of six channels that forget with 20 ms, innovations that are white."""
    frequency = np.linspace(0.0, 100.0, 21)
    slow = np.vstack([2.0 / (1.0 + (frequency / corner) ** 2) for corner in (8.0, 30.0)])
    return ResidualEvidence(
        kinds=("suspension_deflection", "axle_acceleration"),
        frequency_hz=frequency,
        before=slow,
        after=np.ones_like(slow),
        order=np.array([1, 2, 1, 1, 3, 1]),
        lag_s=lag,
        autocorrelation_before=np.tile(np.exp(-lag / 0.02), (6, 1)),
        autocorrelation_after=np.tile((lag == 0.0).astype(float), (6, 1)),
        columns=("l1", "a1"),
        degrees_of_freedom=np.array([np.inf, 4.0]),
    )


def small_history(w: Words = Words(), repeat: int = 1) -> RunHistory:
    """A sine with a fast ripple as its residual; a gap in one channel, clipped samples in another; no band yet."""
    sensors = _sensors(w)
    time = np.arange(400) * 0.005
    simulated = np.array([0.03 * np.sin(9.0 * time + i) for i in range(3)])
    measured = simulated + 1e-3 * np.cos(40.0 * time)
    measured[1, 100:110] = np.nan
    censored = np.zeros((3, 400), np.int8)
    censored[2, 50:53] = 1
    return RunHistory(
        w.run_file.format(repeat), w.case, w.empty, 5.6, 0.01, -0.02, 0.4, tuple(s.column for s in sensors),
        tuple(s.kind for s in sensors), tuple(s.si_unit for s in sensors), tuple(s.axle for s in sensors), time,
        measured, simulated, censored, np.full(3, 1e-3), np.full(3, 8e-4), np.zeros(3), np.zeros(3), np.ones(3),
    )  # fmt: skip


def with_band(history: RunHistory) -> RunHistory:
    """The history with a band of half width 1 mm (or mm/s^2) that fades away."""
    half = 1e-3 * np.exp(-history.time_s)
    return replace(history, band=HistoryBand(history.simulated - half, history.simulated + half))


def _posterior(fit: FitResult) -> Posterior:
    rng = np.random.default_rng(20)
    relative = np.array([p.sd / p.value for p in fit.parameters])
    log_values = np.log([p.value for p in fit.parameters])
    draws = np.exp(log_values + relative * rng.standard_normal((2, 50, 8, 6)))
    flat = draws.reshape(-1, 6)
    summaries = tuple(
        PosteriorSummary(
            p.name, flat[:, i].mean(), flat[:, i].std(), *np.quantile(flat[:, i], [0.05, 0.5, 0.95]), 700.0, 1.003
        )
        for i, p in enumerate(fit.parameters)
    )  # fmt: skip
    return Posterior(
        fit.names, draws, -0.5 * rng.chisquare(6, (2, 50, 8)), 100, 2, np.full(6, 9.0), np.array([0.3, 0.32]),
        summaries, True, False, "Gaussian blocks", "all R-hat below 1.01", 7,
    )  # fmt: skip


def _predictions(w: Words) -> Predictions:
    time = np.arange(-500, 2000) * 1e-3
    static = np.array([39240.0, 29430.0])
    middle = static[:, None] * (1.0 + 0.8 * np.exp(-((time - 0.2) ** 2) / 0.005)) * np.ones((2, 1))
    one = PassPrediction(
        w.empty, 48.0 / 3.6, time, 0.95 * middle, middle, 1.05 * middle, static, np.array([1.7, 3.4]),
        np.array([1.8, 3.6]), np.array([1.9, 3.8]), np.array([False, True]), (w.message,),
        Quantiles(0.8 * middle, 0.9 * middle, middle), _measure(0.3, 0.4), _measure(0.0, 0.012), _measure(0.05, 0.06),
        _measure(0.03, 0.04), _measure(1.0, 0.999),
        trust=(Extrapolation("tire_deflection", 1, 0.045, 0.03), Extrapolation("lift_off", 1, 0.012, 0.0)),
        beyond=np.array([np.zeros(len(time), bool), np.abs(time - 0.2) < 0.0495]),
        profile=ProfileIdentity(w.bump, 0.08, 1.2, "ef" * 32),
    )  # fmt: skip
    speed = np.array([10.0, 25.0, 60.0]) / 3.6
    ratio = 1.0 + speed[:, None] * np.array([0.1, 0.2])
    sweep = SpeedSweep(
        w.empty, w.bump, speed, Quantiles(0.9 * ratio, ratio, 1.1 * ratio),
        Quantiles(0.2 * ratio, 0.3 * ratio, 0.4 * ratio), (20.0 / 3.6, 30.0 / 3.6),
    )  # fmt: skip
    return Predictions((one,), "posterior", (sweep,))


def _measure(front: float, rear: float) -> Quantiles:
    middle = np.array([front, rear])
    return Quantiles(0.9 * middle, middle, 1.1 * middle)


def small_advice(fit: FitResult, w: Words = Words()) -> Advice:
    """One further run halves all standard deviations, with one more sensor it quarters them."""
    sd = np.array([p.sd / p.value for p in fit.parameters])
    now = Prospect("", "", math.nan, "", sd, 0.2)
    run = Prospect(w.laden, w.bump, 20.0 / 3.6, "", sd / 2.0, 0.1)
    sensor = Prospect(w.laden, w.bump, 20.0 / 3.6, "LVDT at axle 2", sd / 4.0, 0.05)
    targets = fit.names[:-1]
    return Advice(fit.names, targets, now, (run,), (sensor,), PeakTarget(1, w.empty, 48.0 / 3.6, 3.6), (w.message,))


def small_profile(name: str = "k_1") -> ProfileLikelihood:
    """A parabola in the logarithm with a standard deviation of 10 % that independent noise takes for 5 %."""
    steps = np.linspace(-3.0, 3.0, 9)
    interval = (4e5 * math.exp(-0.1 * Z90), 4e5 * math.exp(0.1 * Z90))
    value, deviance = 4e5 * np.exp(0.1 * steps), steps**2
    return ProfileLikelihood(
        name, "N/m", 4e5, value, 4.0 * deviance, deviance, 4.0, np.ones(9, bool), interval, interval,
        f"The profile of {name} is a parabola.",
    )  # fmt: skip


def _validation(w: Words) -> Validation:
    return Validation(
        tuple(
            ChannelAgreement(
                w.run_file.format(run),
                s.column,
                s.kind,
                s.axle,
                0.02 * (i + 1),
                1.0 + 0.2 * i,
                400,
                90.0 - i,
                0.1 * (i - 1),
                0.005,
                1.4,
                1.5,
                -0.03 * i,
                0.04,
                0.95 - 0.1 * i,
            )
            for run in (1, 2)
            for i, s in enumerate(_sensors(w))
        )
    )


def before_sampling(words: Words = Words()) -> Results:
    """Results after the fit: no posterior, predictions at the least-squares values."""
    p = _predictions(words).passes[0]
    one = PassPrediction(
        p.load_case, p.speed_m_s, p.time_s, None, p.tire_force_q50_N, None, p.static_load_N, None, p.peak_ratio_q50,
        None, p.lift_off,
    )  # fmt: skip
    return small_results(words, fit=small_fit(words), posterior=None, predictions=Predictions((one,), "least squares"))


def campaign_only(words: Words = Words()) -> Results:
    """Results before any stage has run."""
    return Results(small_campaign(words))
