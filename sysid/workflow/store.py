"""Results of the stages on disk: one file per stage, frozen dataclasses in and out, no pickle.

A stage file is an .npz whose entry ``tree`` is JSON text and whose other entries are the arrays it refers to.  Only
dataclasses of this package that are listed here are ever built from a file.
"""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from sysid.campaign import findings
from sysid.errors import CampaignError
from sysid.estimation.fit import fit_result, profiles, state
from sysid.estimation.parameters import estimate, parameter_set
from sysid.estimation.residuals import residual_weights, run_history, run_motion
from sysid.estimation.uncertainty import identifiability, information, mass_response
from sysid.estimation.weights import residual_evidence
from sysid.export.files import write_atomically
from sysid.planning import advice as advice_results
from sysid.posterior import cross_check
from sysid.posterior import results as posterior_results
from sysid.prediction import results as prediction_results
from sysid.road import results as road_results
from sysid.sdof import results as sdof_results
from sysid.validation import results as validation_results
from sysid.vehicle_model import lanes

_MODULES = (
    findings,
    sdof_results,
    road_results,
    estimate,
    run_history,
    residual_evidence,
    fit_result,
    identifiability,
    profiles,
    posterior_results,
    cross_check,
    prediction_results,
    advice_results,
    validation_results,
)
_CLASSES = {
    name: value
    for module in _MODULES
    for name, value in vars(module).items()
    if isinstance(value, type) and dataclasses.is_dataclass(value)
} | {
    "Parameter": parameter_set.Parameter,
    "PriorLink": parameter_set.PriorLink,
    "ParameterSet": parameter_set.ParameterSet,
    "FitPoint": state.FitPoint,
    "RunMotion": run_motion.RunMotion,
    "Weights": residual_weights.Weights,
    "MassResponse": mass_response.MassResponse,
    "DataInformation": information.DataInformation,
    "MapTires": lanes.MapTires,
}


def save(path: Path, result: Any, fingerprint: str) -> None:
    """Write a stage result atomically, marked with the fingerprint of its inputs."""
    arrays: dict[str, np.ndarray] = {}
    tree = json.dumps({"fingerprint": fingerprint, "result": _encode(result, arrays)})
    arrays["tree"] = np.frombuffer(tree.encode("utf-8"), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]

    def write(temporary: Path) -> None:
        temporary.write_bytes(buffer.getvalue())

    write_atomically(path, write)


def load(path: Path, fingerprint: str) -> Any | None:
    """Read a stage result; None if there is none, it is damaged, or its inputs have changed since."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as handle, np.load(handle, allow_pickle=False) as data:
            tree = json.loads(data["tree"].tobytes().decode("utf-8"))
            if tree["fingerprint"] != fingerprint:
                return None
            return _decode(tree["result"], data)
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
        return None


def _encode(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        name = type(value).__name__
        if name not in _CLASSES:
            raise CampaignError(f"{name} is not a stage result and cannot be kept.")
        members = {f.name: _encode(getattr(value, f.name), arrays) for f in dataclasses.fields(value)}
        return {"class": name, "members": members}
    if isinstance(value, np.ndarray):
        key = f"array_{len(arrays)}"
        arrays[key] = value
        return {"array": key}
    if isinstance(value, tuple | list):
        return {"tuple": [_encode(v, arrays) for v in value]}
    if isinstance(value, dict):
        return {"dict": [[k, _encode(v, arrays)] for k, v in value.items()]}
    if isinstance(value, np.generic):
        return value.item()
    return value


def _decode(value: Any, arrays: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if "class" in value:
        return _CLASSES[value["class"]](**{k: _decode(v, arrays) for k, v in value["members"].items()})
    if "array" in value:
        return arrays[value["array"]]
    if "tuple" in value:
        return tuple(_decode(v, arrays) for v in value["tuple"])
    return {k: _decode(v, arrays) for k, v in value["dict"]}
