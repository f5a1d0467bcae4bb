"""`result.json`: the machine-readable result, schema version 1, SI units, what is not known is null."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.export.identity import Identity, identity_of
from sysid.export.load_effects import load_effect_documents
from sysid.export.naming import prediction_files, speed_km_h
from sysid.files import write_text
from sysid.prediction.predicted_passes import SIDES
from sysid.results.contents import Results
from sysid.sdof.drop_results import DropEstimate

if TYPE_CHECKING:
    from sysid.balance.records import BalanceEstimate
    from sysid.estimation.parameters.estimate import ParameterEstimate
    from sysid.estimation.uncertainty.identifiability import Identifiability
    from sysid.planning.advice_records import Prospect
    from sysid.posterior.sampled_posterior import PosteriorSummary
    from sysid.prediction.predicted_passes import PassPrediction, WheelLoads
    from sysid.prediction.quantiles import Quantiles
    from sysid.validation.channel_agreement import ChannelAgreement, LeftOutRun

#: A number up whenever a key changes its meaning or goes; new keys leave it.
SCHEMA_VERSION = 1


def result_document(results: Results) -> dict[str, Any]:
    """The content of `result.json` as plain Python objects.

    Numbers are in SI (speeds in km/h where the key says so), axles count from 1, and NaN or infinite values and
    stages that have not run are None.
    """
    provenance = results.provenance
    posterior = results.posterior
    seed = provenance.get("seed", posterior.seed if posterior is not None else None)
    document = {
        "schema": SCHEMA_VERSION,
        "campaign": results.campaign.title,
        "status": results.status,
        "seed": None if seed is None else int(seed),
        "inputs": {str(k): str(v) for k, v in sorted(results.input_sha256.items())},
        "likelihood": None if posterior is None else posterior.likelihood,
        "warnings": list(results.all_warnings),
        "timings": {str(k): _number(v) for k, v in provenance.get("timings", {}).items()},
        "drops": _drops(results),
        "parameters": _parameters(results),
        "validation": [] if results.validation is None else [_agreement(row) for row in results.validation.channels],
        "predictions": _predictions(results),
        "load_effects": [] if results.predictions is None else load_effect_documents(results.predictions.passes),
        "identifiability": _identifiability(results),
        "advice": _advice(results),
        "left_out": _left_out(results),
        "rockers": _rockers(results),
        "verdict": None
        if results.judgement is None
        else {
            key: value if isinstance(value, str) else list(value) for key, value in asdict(results.judgement).items()
        },
        "parts": [asdict(d) | {"seen": d.seen} for d in (() if results.fit is None else results.fit.parts)],
        "versions": {str(k): str(v) for k, v in provenance.get("versions", {}).items()},
        "quality": _quality(results),
        "test": asdict(results.campaign.details),
        "speed_sensors": [
            {"channel": s.column, "factor": _number(s.factor), "factor_sd": _number(s.factor_sd), "runs": s.runs}
            for s in (() if results.quality is None else results.quality.speed_sensors)
        ],
        "balance": _balance(results),
        "identity": {"date": provenance.get("date") or None},
    }
    identity = identity_of(document)
    document["identity"] = {
        "run": identity.run,
        "date": identity.date or None,
        "content_sha256": identity.result_sha256,
    }
    return document


def result_identity(results: Results) -> Identity:
    """Which result this is, for everything that is written of it."""
    return identity_of(result_document(results))


def result_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of `result.json`."""
    text = resources.files("sysid.export").joinpath("result.schema.json").read_text(encoding="utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def result_text(results: Results) -> str:
    """The text of `result.json`: UTF-8, two-space indents, keys in the order of the schema."""
    return json.dumps(result_document(results), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_result(results: Results, path: Path) -> None:
    """Write `result.json` to `path`, complete or not at all."""
    write_text(path, result_text(results))


def _number(value: float | None) -> float | None:
    if value is None:
        return None
    value = float(value)
    return value if math.isfinite(value) else None


def _axle(index: int | None) -> int | None:
    return None if index is None else int(index) + 1


def _quality(results: Results) -> list[dict[str, Any]]:
    """Channels of the logs that are not good."""
    return [
        {"file": c.file, "channel": c.column, "kind": c.kind, "verdict": c.verdict, "messages": list(c.messages)}
        for c in (() if results.quality is None else results.quality.channels)
        if c.verdict != "good"
    ]


def _drops(results: Results) -> list[dict[str, Any]]:
    if results.drops is None:
        return []
    single = [estimate for analysis in results.drops.files for estimate in analysis.estimates]
    return [_drop(estimate) for estimate in (*single, *results.drops.pooled)]


def _drop(estimate: DropEstimate) -> dict[str, Any]:
    return {
        "axle": _axle(estimate.axle),
        "load_case": estimate.load_case,
        "file": estimate.file,
        "method": estimate.method,
        "stiffness": _number(estimate.stiffness),
        "damping": _number(estimate.damping),
        "stiffness_sd": _number(estimate.stiffness_sd),
        "damping_sd": _number(estimate.damping_sd),
        "damped_period": _number(estimate.damped_period),
        "log_decrement": _number(estimate.log_decrement),
        "usable": bool(estimate.usable),
        "note": estimate.note,
        "damping_kind": estimate.damping_kind,
        "friction_force": _number(estimate.friction_force),
        "friction_force_sd": _number(estimate.friction_force_sd),
        "quadratic_damping": _number(estimate.quadratic_damping),
        "quadratic_damping_sd": _number(estimate.quadratic_damping_sd),
    }


def _balanced(e: BalanceEstimate) -> dict[str, Any]:
    return {
        "name": e.name,
        "axle": _axle(e.axle),
        "quantity": e.quantity,
        "load_case": e.load_case,
        "unit": e.unit,
        "value": _number(e.value),
        "q05": _number(e.low),
        "q95": _number(e.high),
        "determined": e.determined,
    }


def _balance(results: Results) -> dict[str, Any] | None:
    balance = results.balance
    if balance is None:
        return None
    from sysid.balance.evidence import disagreement

    beside = {} if results.fit is None else {d.name: d for d in disagreement(balance, results.fit)}
    return {
        "estimates": [
            _balanced(e) | {"from_fit_in_sd": _number(beside[e.name].in_sd) if e.name in beside else None}
            for e in balance.estimates
        ],
        "logs": [
            {"file": r.file, "load_case": r.load_case, "used_s": r.used_s, "unexplained": _number(r.unexplained)}
            for r in balance.records
        ],
        "axle_loads": [
            {
                "file": loads.file,
                "load_case": loads.load_case,
                "axle": i + 1,
                "static_load_N": _number(loads.static_N[i]),
                "load_coefficient": _number(loads.coefficient[i]),
                "q05": _number(loads.low[i]),
                "q95": _number(loads.high[i]),
            }
            for loads in balance.loads
            for i in range(len(loads.static_N))
        ],
        "tires": [_balanced(e) for e in balance.tires],
        "roads": [
            {
                "file": r.file,
                "load_case": r.load_case,
                "speed_m_s": _number(r.speed_m_s),
                "speed_m_s_q05": _number(r.speed_low),
                "speed_m_s_q95": _number(r.speed_high),
                "density_m3": _number(r.density_m3),
                "density_m3_q05": _number(r.density_low),
                "density_m3_q95": _number(r.density_high),
                "waviness": _number(r.waviness),
                "road_class": r.road_class,
            }
            for r in balance.roads
        ],
        "converged": balance.converged,
        "messages": list(balance.sentences),
    }


def _parameters(results: Results) -> list[dict[str, Any]]:
    if results.fit is None:
        return []
    summaries = {} if results.posterior is None else {s.name: s for s in results.posterior.summaries}
    estimates = (*results.fit.parameters, *results.fit.run_parameters)
    shares = _interval_shares(results.fit.identifiability)
    return [_parameter(e, summaries.get(e.name), shares.get(e.name)) for e in estimates]


def _interval_shares(identifiability: Identifiability | None) -> dict[str, dict[str, float | None]]:
    """Shares of the sources in the variance of every parameter, by its name."""
    if identifiability is None:
        return {}
    rows, sources = zip(identifiability.names, identifiability.shares, strict=True), identifiability.sources
    return {name: {source: _number(x) for source, x in zip(sources, row, strict=True)} for name, row in rows}


def _parameter(
    estimate: ParameterEstimate, summary: PosteriorSummary | None, shares: dict[str, float | None] | None
) -> dict[str, Any]:
    return {
        "name": estimate.name,
        "axle": _axle(estimate.axle),
        "quantity": estimate.quantity,
        "load_case": estimate.load_case,
        "run": estimate.run,
        "law": estimate.law,
        "unit": estimate.unit,
        "identified": bool(estimate.identified),
        "least_squares": {"value": _number(estimate.value), "sd": _number(estimate.sd)},
        "posterior": None
        if summary is None
        else {key: _number(getattr(summary, key)) for key in ("mean", "sd", "q05", "q50", "q95", "ess", "rhat")},
        "variance_shares": shares,
        "prior": None
        if estimate.transform != "log"
        else {"median": _number(estimate.prior_median), "log_sd": _number(estimate.prior_sd)},
    }


def _rockers(results: Results) -> list[dict[str, Any]]:
    if results.fit is None:
        return []
    proposed = {r.name for r in results.fit.undeclared_rockers}

    rows = [
        (r, "declared" if r.declared else "proposed" if r.name in proposed else "estimated")
        for r in results.load_shares
    ]
    return [
        {
            "name": None if source == "proposed" else r.name,
            "axles": [i + 1 for i in r.axles],
            "load_share": _number(r.share),
            "q05": _number(r.low),
            "q95": _number(r.high),
            "source": source,
        }
        for r, source in rows
    ]


def _identifiability(results: Results) -> dict[str, Any] | None:
    identifiability = None if results.fit is None else results.fit.identifiability
    if identifiability is None:
        return None
    return {
        "determined": identifiability.determined,
        "combinations": len(identifiability.names),
        "singular_values": [_number(v) for v in identifiability.singular_values],
        "open": [
            {"parameters": list(g.names), "known": g.known, "kind": g.kind, "relative_sd": _number(g.relative_sd)}
            for g in identifiability.groups
        ],
        "correlated": [
            {"parameters": [p.first, p.second], "correlation": p.correlation} for p in identifiability.pairs
        ],
        "statements": list(identifiability.statements),
    }


def _advice(results: Results) -> dict[str, Any] | None:
    advice = results.advice
    if advice is None:
        return None

    def row(p: Prospect) -> dict[str, Any]:
        name, worst = advice.worst(p)
        return {
            "load_case": p.load_case or None,
            "bump": p.bump or None,
            "speed_km_h": speed_km_h(p.speed_m_s) if p.load_case else None,
            "sensor": p.sensor or None,
            "worst": name,
            "worst_relative_sd": worst,
            "median_relative_sd": advice.median(p),
            "relative_sd": {target: float(p.sd[advice.names.index(target)]) for target in advice.targets},
            "peak_ratio_sd": _number(p.peak_sd),
            "exact": p.exact or None,
        }

    return {
        "now": row(advice.now),
        "runs": [row(p) for p in advice.runs],
        "sensors": [row(p) for p in advice.sensors],
        "masses": [row(p) for p in advice.masses],
        "peak": None if advice.peak is None else advice.peak.label,
        "statements": list(advice.statements),
    }


def _agreement(row: ChannelAgreement) -> dict[str, Any]:
    return {
        "run": row.run,
        "channel": row.column,
        "nrmse": _number(row.nrmse),
        "iso18571": _number(row.iso18571),
        "sprague_geers": None
        if not math.isfinite(row.sprague_geers_magnitude)
        else {"magnitude": float(row.sprague_geers_magnitude), "phase": float(row.sprague_geers_phase)},
    }


def _left_out(results: Results) -> list[dict[str, Any]]:
    left_out = None if results.validation is None else results.validation.left_out
    if left_out is None:
        return []
    return [_left_out_run(left, left_out.names) for left in left_out.runs]


def _left_out_run(left: LeftOutRun, names: tuple[str, ...]) -> dict[str, Any]:
    def channel(row: ChannelAgreement) -> dict[str, Any]:
        entry = _agreement(row)
        del entry["run"]
        return entry | {"residual_over_noise": _number(row.residual_over_noise)}

    return {
        "run": left.run,
        "converged": bool(left.converged),
        "speed": _number(left.speed_m_s),
        "start": _number(left.start_s),
        "parameters": [
            {"name": name, "value": _number(value), "shift_sd": _number(shift)}
            for name, value, shift in zip(names, left.values, left.shift_sd, strict=True)
        ],
        "channels": [channel(row) for row in left.channels],
    }


def _predictions(results: Results) -> list[dict[str, Any]]:
    if results.predictions is None:
        return []
    passes = results.predictions.passes
    return [
        _prediction(prediction, axle, file)
        for prediction, file in zip(passes, prediction_files(passes), strict=True)
        for axle in range(len(prediction.static_load_N))
    ]


def _wheels(wheels: WheelLoads, axle: int) -> dict[str, Any]:
    """Loads of the wheels of either side of an axle [N]."""

    def bands(values: Quantiles) -> dict[str, float | None]:
        return {key: None if q is None else _number(q[axle]) for key, q in vars(values).items()}

    sides = ((name, wheels.of_side(side)) for side, name in enumerate(SIDES))
    return {name: {"static_N": bands(s.static_N), "peak_N": bands(s.peak_N)} for name, s in sides}


def _prediction(prediction: PassPrediction, axle: int, file: str) -> dict[str, Any]:
    def quantile(values: Any) -> float | None:
        return None if values is None else _number(values[axle])

    return {
        "load_case": prediction.load_case,
        "speed_km_h": speed_km_h(prediction.speed_m_s),
        "axle": axle + 1,
        "peak_dynamic_load_ratio": {
            "q05": quantile(prediction.peak_ratio_q05),
            "q50": quantile(prediction.peak_ratio_q50),
            "q95": quantile(prediction.peak_ratio_q95),
        },
        "lift_off": bool(prediction.lift_off[axle]),
        **({} if prediction.wheels is None else {"wheels": _wheels(prediction.wheels, axle)}),
        "file": file,
        "trust": [
            {
                "what": e.what,
                "axle": e.axle + 1,
                "reached": _number(e.reached),
                "driven": _number(e.driven),
                **({} if e.assumed is None else {"assumed_stop": _number(e.assumed)}),
            }
            for e in prediction.trust
            if e.axle == axle
        ],
        "shape": None if prediction.profile is None else asdict(prediction.profile),
    }
