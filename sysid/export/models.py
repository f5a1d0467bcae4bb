"""Files with the calibrated vehicle and the predicted loads for other programs, one folder per load case."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.export.bridge import moving_forces_csv, vehicle_csv
from sysid.export.chrono import chrono_suspension, chrono_text, chrono_tire
from sysid.export.identity import Identity, stamped
from sysid.export.lsdyna import lsdyna_text
from sysid.export.naming import file_stem, prediction_files
from sysid.files import write_text
from sysid.tabular import distinct

if TYPE_CHECKING:
    from sysid.campaign.records import Campaign
    from sysid.estimates.calibrated_elements import CalibratedVehicle
    from sysid.prediction.predicted_passes import Predictions
    from sysid.results.contents import Judgement


def model_texts(
    campaign: Campaign, vehicles: Iterable[CalibratedVehicle], judgement: Judgement | None = None
) -> dict[str, str]:
    """Texts by file name below the output folder: LS-DYNA, Chrono::Vehicle and vehicle-bridge interaction."""
    vehicles = tuple(vehicles)
    folders = distinct(file_stem(v.load_case) for v in vehicles)
    texts = {}
    for vehicle, name in zip(vehicles, folders, strict=True):
        folder = f"models/{name}"
        texts[f"{folder}/lsdyna.k"] = lsdyna_text(vehicle, judgement)
        texts[f"{folder}/vehicle.csv"] = vehicle_csv(campaign, vehicle, judgement)
        for s in vehicle.suspensions:
            texts[f"{folder}/chrono_suspension{s.axle + 1}.json"] = chrono_text(
                chrono_suspension(vehicle, s, judgement)
            )
        for i in range(len(campaign.vehicle.axles)):
            texts[f"{folder}/chrono_tire{i + 1}.json"] = chrono_text(chrono_tire(vehicle, i, judgement))
    return texts


def moving_force_texts(
    campaign: Campaign, predictions: Predictions, judgement: Judgement | None = None
) -> dict[str, str]:
    """Texts by file name below the output folder, one per predicted pass."""
    names = prediction_files(predictions.passes)
    return {
        name.replace("predictions/", "moving_forces/", 1): moving_forces_csv(campaign, p, judgement)
        for name, p in zip(names, predictions.passes, strict=True)
    }


def write_moving_forces(
    campaign: Campaign, predictions: Predictions, folder: Path, judgement: Judgement | None = None
) -> tuple[Path, ...]:
    """Write `moving_forces/*.csv` of passes below the output `folder`, each complete or not at all; their paths."""
    texts = moving_force_texts(campaign, predictions, judgement)
    for name, text in texts.items():
        write_text(Path(folder) / name, text)
    return tuple(Path(folder) / name for name in texts)


def write_models(
    campaign: Campaign,
    vehicles: Iterable[CalibratedVehicle],
    predictions: Predictions | None,
    folder: Path,
    judgement: Judgement | None = None,
    identity: Identity | None = None,
) -> tuple[Path, ...]:
    """Write all files for other programs below the output `folder`, each complete or not at all; their paths.

    Parameters
    ----------
    vehicles : calibrated vehicle of every load case (:func:`sysid.estimates.calibrated.calibrated_vehicle`).
    predictions : predicted passes, None for none.
    judgement : whether vehicles and passes may be used; every file says so.
    identity : of the result, written into files that have a place for it.
    """
    texts = model_texts(campaign, vehicles, judgement)
    if predictions is not None:
        texts |= moving_force_texts(campaign, predictions, judgement)
    paths = tuple(Path(folder) / name for name in texts)
    for path, (name, text) in zip(paths, texts.items(), strict=True):
        write_text(path, text if identity is None else stamped(name, text, identity))
    return paths
