"""Tables for spreadsheets and other programs: `parameters.csv`, `validation.csv` and `predictions/*.csv`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.csv_cells import csv_text, escape_cell, number_cell
from sysid.export.load_effects import load_effect_texts
from sysid.export.naming import file_stem, prediction_files, speed_km_h
from sysid.export.road_tables import road_texts
from sysid.files import write_text
from sysid.prediction.predicted_passes import SIDES
from sysid.prediction.quantiles import Quantiles
from sysid.results.contents import Judgement, Results
from sysid.results.parameter_table import parameter_table
from sysid.tabular import distinct
from sysid.validation.channel_agreement import ChannelAgreement

if TYPE_CHECKING:
    from sysid.estimation.fit.profiles import ProfileLikelihood
    from sysid.prediction.predicted_passes import PassPrediction, Predictions
    from sysid.validation.channel_agreement import Validation


def parameters_csv(results: Results) -> str:
    """The text of `parameters.csv`: one row per parameter in SI units, empty cells for what is not known."""
    return parameter_table(results.campaign.vehicle.axles, results.fit, results.posterior, results.trust)


def write_parameters(results: Results, path: Path) -> None:
    """Write `parameters.csv` to `path`, complete or not at all."""
    write_text(path, parameters_csv(results))


def validation_csv(validation: Validation) -> str:
    """The text of `validation.csv`: agreement of every channel of every run, SI units, empty where not known.

    The last column names the limits that a channel does not keep.
    """
    names = [f.name for f in fields(ChannelAgreement)]
    rows = (
        [*(_validation_cell(name, getattr(row, name)) for name in names), " ".join(validation.limits.exceeded(row))]
        for row in (*validation.channels, *validation.out_of_sample)
    )
    return csv_text((*names, "outside_limits"), rows)


def _validation_cell(name: str, value: str | int | float | None) -> str | int:
    if isinstance(value, bool):
        return "true" if value else "false"
    if name == "axle":
        return "" if value is None else int(value) + 1
    return escape_cell(value) if isinstance(value, str) else value if isinstance(value, int) else number_cell(value)


def profile_csv(profile: ProfileLikelihood) -> str:
    """The text of a file of `profiles/`: value in SI units, deviance of independent noise and after adjustment."""
    return profile.summary().to_csv(index=False, lineterminator="\n")


def write_profiles(profiles: Sequence[ProfileLikelihood], folder: Path) -> list[Path]:
    """Write `profiles/NAME.csv` for every profile, names made safe for files."""
    written = []
    stems = distinct(file_stem(profile.name) for profile in profiles)
    for profile, stem in zip(profiles, stems, strict=True):
        path = folder / "profiles" / f"{stem}.csv"
        write_text(path, profile_csv(profile))
        written.append(path)
    return written


def write_validation(results: Results, path: Path) -> None:
    """Write `validation.csv` to `path`, complete or not at all; nothing where no run has been fitted."""
    if results.validation is not None:
        write_text(path, validation_csv(results.validation))


def prediction_csv(prediction: PassPrediction, judgement: Judgement | None = None) -> str:
    """The text of one `predictions/*.csv`: time [s], quantiles of each axle's vertical tire and suspension force [N].

    Where the fit knows of roll, there are those of left and right wheels too (``left_tire_force1_N_q50`` ...).
    Before sampling the columns of the 5 % and 95 % quantiles are empty. ``beyond_driven1`` ... are 1 at instants at
    which the axle is beyond what the driven runs reached, and 0 at others. ``do_not_bet`` is 1 if the forces and their
    intervals should not be used (`verdict` of `result.json`), else 0; the column is absent without a judgement.
    """
    # Rounded to 1 us and 0.01 N: far below what the model knows, and a file half the size.
    columns = {"time_s": np.round(prediction.time_s, 6)}
    p, s = prediction, prediction.suspension_force_N
    forces = {"tire_force": (p.tire_force_q05_N, p.tire_force_q50_N, p.tire_force_q95_N)}
    if s is not None:
        forces["suspension_force"] = (s.q05, s.q50, s.q95)
    if p.wheels is not None:
        for side, name in enumerate(SIDES):
            of_side = p.wheels.of_side(side).force_N
            forces[f"{name}_tire_force"] = (of_side.q05, of_side.q50, of_side.q95)
    for name, bands in forces.items():
        for axle in range(len(p.static_load_N)):
            for key, force in zip(("q05", "q50", "q95"), bands, strict=True):
                values = np.full(len(p.time_s), np.nan) if force is None else np.round(force[axle], 2)
                columns[f"{name}{axle + 1}_N_{key}"] = values
    columns |= beyond_columns(p) | bet_column(p, judgement)
    import pandas as pd

    return pd.DataFrame(columns).to_csv(index=False, lineterminator="\n")


def beyond_columns(p: PassPrediction) -> dict[str, np.ndarray]:
    """Columns ``beyond_driven1`` ... of a pass: 1 where the axle is beyond the driven runs; none where not known."""
    return {} if p.beyond is None else {f"beyond_driven{i + 1}": row.astype(int) for i, row in enumerate(p.beyond)}


def bet_column(p: PassPrediction, judgement: Judgement | None) -> dict[str, np.ndarray]:
    """Column ``do_not_bet`` of a pass: 1 where nobody should rely on its forces, else 0; none without a judgement."""
    return {} if judgement is None else {"do_not_bet": np.full(len(p.time_s), int(judgement.forbids))}


def pass_measures_csv(predictions: Predictions, trust: str | None = None) -> str:
    """The text of `predictions/peaks.csv`: a row per pass, axle and measure with its quantiles.

    Measures of the whole vehicle have no axle.  The last columns name what of the axle goes beyond the driven runs,
    words as in `trust` of a pass in `result.json`, and whether the numbers may be used, as its `verdict`.
    """
    rows = []
    passes = predictions.passes
    for p, file in zip(passes, prediction_files(passes), strict=True):
        for axle in range(len(p.static_load_N)):
            head = [escape_cell(p.load_case), speed_km_h(p.speed_m_s), escape_cell(p.shape), axle + 1]
            for name, values in _measures(p):
                if values is not None:
                    beyond = " ".join(e.what for e in p.trust if e.axle == axle)
                    rows.append([*head, name, *_bands(values, axle), file, beyond, trust or ""])
        for name, values in _of_vehicle(p):
            rows.append([*head[:3], "", name, *_bands(values, 0), file, "", trust or ""])
    names = ("load_case", "speed_km_h", "shape", "axle", "measure", "q05", "q50", "q95", "file", "beyond_driven")
    return csv_text((*names, "verdict"), rows)


def speed_sweeps_csv(predictions: Predictions, trust: str | None = None) -> str:
    """The text of `predictions/against_speed.csv`: a row per load case, speed and axle with quantiles."""
    rows = [
        [
            escape_cell(s.load_case),
            escape_cell(s.bump),
            speed_km_h(speed),
            axle + 1,
            *_bands(s.peak_ratio, (i, axle)),
            *_bands(s.load_coefficient, (i, axle)),
            "true" if s.extrapolated[i] else "false",
            "" if s.beyond is None else "true" if s.beyond[i, axle] else "false",
            trust or "",
        ]
        for s in predictions.sweeps
        for i, speed in enumerate(s.speed_m_s)
        for axle in range(s.peak_ratio.q50.shape[1])
    ]
    names = [f"{name}_{q}" for name in ("peak_dynamic_load_ratio", "load_coefficient") for q in ("q05", "q50", "q95")]
    flags = ("extrapolated", "beyond_driven", "verdict")
    return csv_text(("load_case", "bump", "speed_km_h", "axle", *names, *flags), rows)


def _measures(p: PassPrediction) -> tuple[tuple[str, Quantiles | None], ...]:
    names = ("load_coefficient", "lift_off_s", "jounce_m", "rebound_m", "impulse_ratio")
    static = Quantiles(None, 1e-3 * p.static_load_N, None)
    found: list[tuple[str, Quantiles | None]] = [("peak_dynamic_load_ratio", p.peak_ratio)]
    found += [("static_axle_load_kN", static), ("peak_axle_load_kN", p.axle_load_kN)]
    if p.wheels is not None:
        for side, name in enumerate(SIDES):
            of_side = p.wheels.of_side(side)
            found.append((f"static_{name}_wheel_load_kN", of_side.static_N.times(1e-3)))
            found.append((f"peak_{name}_wheel_load_kN", of_side.peak_N.times(1e-3)))
    found += [(name, getattr(p, name)) for name in names]
    if p.road is not None:
        found += [("axle_load_95_kN", p.road.load_95_N.times(1e-3)), ("axle_load_99_kN", p.road.load_99_N.times(1e-3))]
        found += [("road_stress_factor", p.road.road_stress)]
    return tuple(found)


def _of_vehicle(p: PassPrediction) -> tuple[tuple[str, Quantiles], ...]:
    """Measures of a whole vehicle and of its road, (1,) each."""
    if p.road is None:
        return ()
    road = p.road
    found = [("vehicle_stress_factor", road.vehicle_stress), ("aggregate_stress_95", road.aggregate_95)]
    for name, value in (("iri_mm_per_m", road.roughness_index_mm_m), ("road_density_m3", road.density_m3)):
        if value is not None:
            found.append((name, Quantiles(None, np.array([value]), None)))
    return tuple(found)


def _bands(values: Quantiles, index: int | tuple[int, int]) -> list[str]:
    return [number_cell(None if q is None else float(q[index])) for q in (values.q05, values.q50, values.q95)]


def write_passes(
    predictions: Predictions, folder: Path, judgement: Judgement | None = None, trust: str | None = None
) -> tuple[Path, ...]:
    """Write passes that belong to no results below the output `folder`, and return the paths.

    Each has its histories as `predictions/NAME.csv` and its measures as `predictions/NAME_peaks.csv`, with the columns
    of `predictions/peaks.csv`.
    """
    paths = []
    for prediction, name in zip(predictions.passes, prediction_files(predictions.passes), strict=True):
        one = replace(predictions, passes=(prediction,), sweeps=())
        texts = {name: prediction_csv(prediction, judgement)}
        texts[f"{name.removesuffix('.csv')}_peaks.csv"] = pass_measures_csv(one, trust)
        for file, text in texts.items():
            write_text(Path(folder) / file, text)
            paths.append(Path(folder) / file)
    for file, text in road_texts(predictions.passes, "repeatability_asked", trust).items():
        write_text(Path(folder) / file, text)
        paths.append(Path(folder) / file)
    return tuple(paths)


def write_predictions(results: Results, folder: Path) -> tuple[Path, ...]:
    """Write one file per predicted pass and the tables of all below the output `folder` and return their paths."""
    if results.predictions is None:
        return ()
    passes = results.predictions.passes
    histories = [prediction_csv(p, results.judgement) for p in passes]
    texts = dict(zip(prediction_files(passes), histories, strict=True))
    texts["predictions/peaks.csv"] = pass_measures_csv(results.predictions, results.trust)
    if results.predictions.sweeps:
        texts["predictions/against_speed.csv"] = speed_sweeps_csv(results.predictions, results.trust)
    texts |= load_effect_texts(passes, "load_effects", results.trust)
    texts |= road_texts(passes, "repeatability", results.trust)
    for name, text in texts.items():
        write_text(Path(folder) / name, text)
    return tuple(Path(folder) / name for name in texts)
