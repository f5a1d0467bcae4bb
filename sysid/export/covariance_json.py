"""`covariance.json`: estimates with their joint covariance, and how they go with errors that campaigns can share.

With it campaigns are compared (`calibrate.py compare`), and loads computed by other programs get intervals.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.export.identity import content_sha256
from sysid.export.result_json import result_identity
from sysid.files import write_text
from sysid.results.contents import Results

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.posterior.sampled_posterior import Posterior

#: A number up whenever a key changes its meaning or goes; new keys leave it.
SCHEMA_VERSION = 1
COVARIANCE_FILE = "covariance.json"
#: Digits of the numbers: what data say of an error is left when its prior, a thousand times as strong, is taken away.
_DIGITS = 12


def covariance_document(results: Results) -> dict[str, Any] | None:
    """The content of `covariance.json` as plain Python objects; None before a fit.

    - `converged`: whether least squares ended at a minimum; else all of this is that of some other point;
    - `estimates`: per parameter its median `log_value` (of the value in its SI `unit`), and what it is;
    - `covariance`: of these logarithms, everything else integrated out;
    - `errors`: of declared masses and of the contact model, in standard deviations `sd` before the data: `kind`,
      `place` (axle, body or beam, from 1), `load_case`, the `declared` value, the `estimate`;
    - `error_covariance` of these, and `sensitivity`: by how much a logarithm changes per standard deviation of each;
    - `declared`: axles, positions, and axle loads as weighed, by load case [kg];
    - `identity`: `run`, hashes of inputs and result as in `result.json`, and that of all of this without `identity`.
    """
    fit = results.fit
    if fit is None or fit.further is None:
        return None
    identity, further = result_identity(results), fit.further
    centre, covariance = _normal(fit, results.posterior)
    vehicle = results.campaign.vehicle
    document = {
        "schema": SCHEMA_VERSION,
        "converged": bool(fit.converged),
        "estimates": [
            {
                "name": p.name,
                "quantity": p.quantity,
                "axle": None if p.axle is None else p.axle + 1,
                "load_case": p.load_case,
                "law": p.law,
                "unit": p.unit,
                "identified": bool(p.identified),
                "log_value": _number(x),
            }
            for p, x in zip(fit.parameters, centre, strict=True)
        ],
        "covariance": _matrix(covariance),
        "errors": [
            {
                "kind": u.kind,
                "beam": u.beam,
                "place": None if u.place is None else u.place + 1,
                "load_case": u.load_case,
                "declared": _number(u.declared),
                "sd": _number(u.sd),
                "estimate": _number(z),
            }
            for u, z in zip(further.unknowns, further.estimate, strict=True)
        ],
        "error_covariance": _matrix(further.covariance),
        "sensitivity": _matrix(further.sensitivity),
        "declared": {
            "vehicle": vehicle.name,
            "axles": [a.name for a in vehicle.axles],
            "x_m": [_number(a.x_m) for a in vehicle.axles],
            "gravity_m_s2": _number(vehicle.gravity_m_s2),
            "axle_loads_kg": {
                name: [_number(load) for load in case.axle_loads_kg]
                for name, case in results.campaign.load_cases.items()
                if name in results.campaign.load_cases_in_use
            },
        },
    }
    document["identity"] = {
        "run": identity.run,
        "inputs_sha256": identity.inputs_sha256,
        "result_sha256": identity.result_sha256,
        "content_sha256": content_sha256(document),
    }
    return document


def write_covariance(results: Results, path: Path) -> bool:
    """Write `covariance.json` to `path`, complete or not at all; False before a fit, which leaves nothing to write."""
    document = covariance_document(results)
    if document is None:
        return False
    write_text(path, json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n")
    return True


def _normal(fit: FitResult, posterior: Posterior | None) -> tuple[np.ndarray, np.ndarray]:
    """Mean (p,) and covariance (p, p) of the log parameters: of the draws, of least squares before there are any."""
    if posterior is None:
        return np.log([p.value for p in fit.parameters]), fit.covariance
    logs = np.log(posterior.draws).reshape(-1, len(posterior.names))
    return logs.mean(axis=0), np.atleast_2d(np.cov(logs, rowvar=False))


def _number(value: float) -> float:
    return float(f"{float(value):.{_DIGITS}g}")


def _matrix(values: np.ndarray) -> list[list[float]]:
    return [[_number(x) for x in row] for row in values]
