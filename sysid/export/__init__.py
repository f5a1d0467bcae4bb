"""Files for other programs: result.json, parameters.csv, validation.csv, predictions/*.csv, posterior.nc; models."""

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
