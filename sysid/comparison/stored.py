"""A finished output folder as comparisons need it: read back, and checked to be what one calibration wrote."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sysid.errors import CampaignError, StoredResultsError
from sysid.export.covariance_json import COVARIANCE_FILE, SCHEMA_VERSION
from sysid.export.identity import Identity, content_sha256, identity_of
from sysid.files import read_json
from sysid.results.contents import Status, Trust
from sysid.wording import shorten

RESULT_FILE = "result.json"

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Matrix = list[list[Real]]
Name = Annotated[str, Field(strict=True, max_length=2000)]
Number = Annotated[int, Field(strict=True, ge=1, le=1000)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class StoredEstimate(_Part):
    """One parameter: what it is, and the logarithm of its value in its SI unit."""

    name: Name
    quantity: Name
    axle: Number | None
    load_case: Name | None
    law: Name
    unit: Name
    identified: bool
    log_value: Real


class StoredError(_Part):
    """One error of a declared mass or of the contact model, in standard deviations `sd` before the data."""

    kind: Name
    beam: bool
    place: Number | None
    load_case: Name | None
    declared: Real
    sd: Annotated[Real, Field(gt=0.0)]
    estimate: Real


class _Declared(_Part):
    vehicle: Name
    axles: list[Name]
    x_m: list[Real]
    gravity_m_s2: Real
    axle_loads_kg: dict[Name, list[Real]]


class _Covariance(_Part):
    schema_: Literal[1] = Field(alias="schema")
    converged: bool = True
    estimates: list[StoredEstimate]
    covariance: Matrix
    errors: list[StoredError]
    error_covariance: Matrix
    sensitivity: Matrix
    declared: _Declared


class _Peak(_Part):
    q05: Real | None
    q50: Real | None
    q95: Real | None


class StoredPeak(_Part):
    """Peak dynamic load ratio of one axle in one predicted pass."""

    load_case: Name
    speed_km_h: Real
    axle: Number
    peak_dynamic_load_ratio: _Peak
    shape: dict[str, Any] | None = None
    file: Name = ""


class _Test(_Part):
    date: Name | None = None
    place: Name | None = None
    operator: Name | None = None
    vehicle_id: Name | None = None
    scale: Name | None = None


class _Verdict(_Part):
    trust: Trust
    reasons: list[Name] = []


class _Result(_Part):
    campaign: Name
    status: Status
    verdict: _Verdict | None
    predictions: list[StoredPeak]
    test: _Test


@dataclass(frozen=True)
class StoredResult:
    """What one finished campaign says.

    - `folder`: its output folder, `label` its name in tables;
    - `status`, `trust` and `reasons` as in `result.json`; `converged`: whether its fit ended at a minimum;
    - `estimates` (p) with `covariance` (p, p) of their logarithms, `sampled` whether it is that of a posterior;
    - `errors` (q) with `error_covariance` (q, q) in prior standard deviations, `sensitivity` (p, q) of the logarithms;
    - `axles` by name, `x_m` behind the first, `axle_loads_kg` as weighed by load case;
    - `peaks`: of predicted passes.
    """

    folder: Path
    label: str
    title: str
    identity: Identity
    status: Status
    converged: bool
    trust: Trust | None
    reasons: tuple[str, ...]
    test: Mapping[str, str | None]
    vehicle: str
    axles: tuple[str, ...]
    x_m: tuple[float, ...]
    gravity_m_s2: float
    axle_loads_kg: Mapping[str, tuple[float, ...]]
    estimates: tuple[StoredEstimate, ...]
    covariance: np.ndarray
    errors: tuple[StoredError, ...]
    error_covariance: np.ndarray
    sensitivity: np.ndarray
    peaks: tuple[StoredPeak, ...]


def read_result(folder: Path) -> StoredResult:
    """Read what a finished campaign left in its output folder.

    Raises
    ------
    CampaignError
        If it is no output folder, or its results have no fit.
    StoredResultsError
        If its files are damaged, changed, or of two calibrations.
    """
    name = shorten(folder, 100)
    result, covariance = read_json(folder / RESULT_FILE), read_json(folder / COVARIANCE_FILE)
    if not folder.is_dir():
        raise CampaignError(f"{name} is no folder; give output folders of finished calibrations.")
    if not result:
        raise CampaignError(f"{name} holds no {RESULT_FILE} that can be read; give output folders of 'run' or 'fit'.")
    if not covariance:
        raise CampaignError(
            f"{name} holds no {COVARIANCE_FILE} that can be read: it has no fit, or an older version wrote it; run "
            "'fit' or 'run' again."
        )
    if covariance.get("schema") != SCHEMA_VERSION:
        raise CampaignError(f"{name}/{COVARIANCE_FILE} is of another version of the program; run 'fit' or 'run' again.")
    try:
        read, joint = _Result.model_validate(result), _Covariance.model_validate(covariance)
        identity = identity_of(result)
        matrices = _matrices(joint)
    except (ValidationError, ValueError, RecursionError):
        raise StoredResultsError(f"The results in {name} are damaged; run the calibration again.") from None
    stamp, own = covariance.get("identity"), result.get("identity")
    said = own.get("content_sha256") if isinstance(own, dict) else None
    if said != identity.result_sha256:
        raise StoredResultsError(
            f"{name}/{RESULT_FILE} was changed after it was written; run 'export' or the calibration again."
        )
    if not isinstance(stamp, dict) or stamp.get("result_sha256") != identity.result_sha256:
        raise StoredResultsError(
            f"{RESULT_FILE} and {COVARIANCE_FILE} in {name} are of two calibrations; run 'export' again."
        )
    # Files of earlier versions do not say what they held.
    if stamp.get("content_sha256", content_sha256(covariance)) != content_sha256(covariance):
        raise StoredResultsError(
            f"{name}/{COVARIANCE_FILE} was changed after it was written; run 'export' or the calibration again."
        )
    details = read.test.model_dump()
    declared = joint.declared
    return StoredResult(
        folder=folder,
        label=folder.resolve().name or name,
        title=read.campaign,
        identity=identity,
        status=read.status,
        converged=joint.converged,
        trust=None if read.verdict is None else read.verdict.trust,
        reasons=() if read.verdict is None else tuple(read.verdict.reasons),
        test=details,
        vehicle=declared.vehicle,
        axles=tuple(declared.axles),
        x_m=tuple(declared.x_m),
        gravity_m_s2=declared.gravity_m_s2,
        axle_loads_kg={k: tuple(v) for k, v in declared.axle_loads_kg.items()},
        estimates=tuple(joint.estimates),
        errors=tuple(joint.errors),
        peaks=tuple(read.predictions),
        **matrices,
    )


def _matrices(joint: _Covariance) -> dict[str, np.ndarray]:
    """The arrays of a covariance file; ValueError where they do not fit each other or are no covariances."""
    parameters, errors, axles = len(joint.estimates), len(joint.errors), len(joint.declared.axles)
    matrices = {
        "covariance": np.reshape(np.array(joint.covariance, float), (parameters, parameters)),
        "error_covariance": np.reshape(np.array(joint.error_covariance, float), (errors, errors)),
        "sensitivity": np.reshape(np.array(joint.sensitivity, float), (parameters, errors)),
    }
    np.linalg.cholesky(matrices["error_covariance"]) if errors else None
    if not parameters or (np.diag(matrices["covariance"]) <= 0.0).any():
        raise ValueError("no covariance")
    lengths = {len(joint.declared.x_m), *map(len, joint.declared.axle_loads_kg.values())}
    if lengths != {axles} or not all(load > 0.0 for of in joint.declared.axle_loads_kg.values() for load in of):
        raise ValueError("axles and loads do not fit")
    if any(not math.isfinite(math.exp(min(e.log_value, 700.0))) for e in joint.estimates):
        raise ValueError("no value")
    return matrices
