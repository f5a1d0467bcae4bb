"""Files for other programs: result.json, parameters.csv, validation.csv, predictions/*.csv, posterior.nc; models."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.csv_cells import escape_cell
    from sysid.export.chrono import chrono_merged, read_chrono
    from sysid.export.inference_data import posterior_tree, write_posterior
    from sysid.export.models import model_texts, moving_force_texts, write_models
    from sysid.export.naming import prediction_files
    from sysid.export.result_json import result_document, result_schema, write_result
    from sysid.export.tables import (
        parameters_csv,
        prediction_csv,
        validation_csv,
        write_parameters,
        write_predictions,
        write_validation,
    )
    from sysid.results.contents import Results

_HOMES = {
    "Results": "sysid.results.contents",
    "chrono_merged": "sysid.export.chrono",
    "escape_cell": "sysid.csv_cells",
    "model_texts": "sysid.export.models",
    "moving_force_texts": "sysid.export.models",
    "parameters_csv": "sysid.export.tables",
    "posterior_tree": "sysid.export.inference_data",
    "prediction_csv": "sysid.export.tables",
    "prediction_files": "sysid.export.naming",
    "read_chrono": "sysid.export.chrono",
    "result_document": "sysid.export.result_json",
    "result_schema": "sysid.export.result_json",
    "validation_csv": "sysid.export.tables",
    "write_models": "sysid.export.models",
    "write_parameters": "sysid.export.tables",
    "write_posterior": "sysid.export.inference_data",
    "write_predictions": "sysid.export.tables",
    "write_result": "sysid.export.result_json",
    "write_validation": "sysid.export.tables",
}

__all__ = [
    "Results",
    "chrono_merged",
    "escape_cell",
    "model_texts",
    "moving_force_texts",
    "parameters_csv",
    "posterior_tree",
    "prediction_csv",
    "prediction_files",
    "read_chrono",
    "result_document",
    "result_schema",
    "validation_csv",
    "write_models",
    "write_parameters",
    "write_posterior",
    "write_predictions",
    "write_result",
    "write_validation",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
