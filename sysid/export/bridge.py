"""Tables for bridge programs: the vehicle for vehicle-bridge interaction codes, moving forces for all others."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

import numpy as np

from sysid.campaign.statics import static_equilibrium
from sysid.csv_cells import escape_cell, number_cell
from sysid.export.tables import bet_column, beyond_columns

if TYPE_CHECKING:
    from sysid.campaign.records import Campaign
    from sysid.estimates.calibrated_elements import CalibratedVehicle
    from sysid.prediction.predicted_passes import PassPrediction
    from sysid.results.contents import Judgement

VEHICLE_COLUMNS = (
    "kind",
    "number",
    "name",
    "body",
    "x_m",
    "hitch_x_m",
    "static_load_N",
    "mass_kg",
    "pitch_inertia_kg_m2",
    "cg_height_m",
    "suspension_stiffness_N_per_m",
    "suspension_damping_N_s_per_m",
    "suspension_friction_N",
    "tire_stiffness_N_per_m",
    "tire_damping_N_s_per_m",
    "load_share",
    "bending_frequency_hz",
    "bending_damping_ratio",
    "bending_modal_mass_kg",
    "load_case",
    "source",
    "verdict",
)


def vehicle_csv(campaign: Campaign, vehicle: CalibratedVehicle, judgement: Judgement | None = None) -> str:
    """The vehicle of a load case: rows of bodies, groups and axles in SI units, cells empty where nothing belongs.

    A body has its mass, its pitch inertia about its centre of gravity, which stands at `x_m` behind axle 1, and the
    hinge to the body in front.  An axle has its unsprung mass, static road load, and suspension and tire values:
    stiffness is the tangent at rest, damping the secant at 0.5 m/s.  In an axle group the group's row holds the
    suspension, and its beam's mass and inertia.  An equaliser, a massless rocker between the springs of its axles, has
    its load share s, and its axles' rows their own suspensions: with spring forces S_i each axle feels
    S_i + s (mean S - S_i).  A body whose frame bends has the frequency, damping ratio and modal mass of its first free
    mode.  The last column says in every row whether the values may be used, as `result.json` does.
    """
    case, truck = campaign.load_cases[vehicle.load_case], campaign.vehicle
    statics = static_equilibrium(truck, case)
    suspension = {s.axle: s for s in vehicle.suspensions}
    grouped = {i for group in truck.groups for i in group.axles}
    bends = {
        f.body: {
            "bending_frequency_hz": number_cell(f.frequency_hz),
            "bending_damping_ratio": number_cell(f.damping_ratio),
            "bending_modal_mass_kg": number_cell(f.modal_mass_kg),
        }
        for f in vehicle.frames
    }
    rows: list[dict[str, object]] = []
    for b, body in enumerate(truck.bodies):
        rows.append(
            {"kind": "body", "number": b + 1, "name": escape_cell(body.name), "body": b + 1,
             "x_m": number_cell(statics.cg_x_m[b]), "hitch_x_m": number_cell(body.hitch_x_m),
             "mass_kg": number_cell(case.sprung_mass_kg[b]),
             "pitch_inertia_kg_m2": number_cell(case.pitch_inertia_kg_m2[b]),
             "cg_height_m": number_cell(case.cg_height_m[b]), **bends.get(b, {})}
        )  # fmt: skip

    def spring_cells(axle: int) -> dict[str, object]:
        s = suspension[axle]
        return {
            "suspension_stiffness_N_per_m": number_cell(s.stiffness_N_per_m),
            "suspension_damping_N_s_per_m": number_cell(s.damping_N_s_per_m),
            "suspension_friction_N": number_cell(s.friction_N),
        }

    for g, group in enumerate(truck.groups):
        first = group.axles[0]
        rows.append(
            {"kind": "group", "number": g + 1, "name": escape_cell(group.name), "body": truck.axles[first].body + 1,
             "x_m": number_cell(truck.suspension_x_m[first]), "mass_kg": number_cell(group.mass_kg),
             "pitch_inertia_kg_m2": number_cell(group.pitch_inertia_kg_m2), **spring_cells(first)}
        )  # fmt: skip
    for g, rocker in enumerate(vehicle.rockers):
        axles = " ".join(str(i + 1) for i in rocker.axles)
        rows.append(
            {"kind": "equaliser", "number": len(truck.groups) + g + 1, "name": escape_cell(f"{rocker.name} ({axles})"),
             "body": truck.axles[rocker.axles[0]].body + 1, "load_share": number_cell(rocker.share),
             "x_m": number_cell(sum(truck.axles[i].x_m for i in rocker.axles) / len(rocker.axles))}
        )  # fmt: skip
    for i, axle in enumerate(truck.axles):
        rows.append(
            {"kind": "axle", "number": i + 1, "name": escape_cell(axle.name), "body": axle.body + 1,
             "x_m": number_cell(axle.x_m), "static_load_N": number_cell(statics.tire_load_N[i]),
             "mass_kg": number_cell(axle.unsprung_mass_kg), **({} if i in grouped else spring_cells(i)),
             "tire_stiffness_N_per_m": number_cell(vehicle.tire_stiffness_N_per_m[i]),
             "tire_damping_N_s_per_m": number_cell(vehicle.tire_damping_N_s_per_m[i])}
        )  # fmt: skip
    stream = io.StringIO()
    writer = csv.DictWriter(stream, VEHICLE_COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    verdict = "" if judgement is None else judgement.trust
    about = {"load_case": escape_cell(case.name), "source": vehicle.source, "verdict": verdict}
    writer.writerows(row | about for row in rows)
    return stream.getvalue()


def moving_forces_csv(campaign: Campaign, prediction: PassPrediction, judgement: Judgement | None = None) -> str:
    """Moving forces of a pass: time [s], per axle its station [m] and vertical force on the road [N] with bands.

    Axle i is at v t - x_i from the start of the bump in the direction of travel. The force is that of all its tires,
    downward, static load included. Quantiles are pointwise; those of 5 % and 95 % are empty before sampling.
    ``beyond_driven1`` ... are 1 where the axle is beyond what the driven runs reached; ``do_not_bet`` as in
    :func:`sysid.export.tables.prediction_csv`.
    """
    p = prediction
    columns = {"time_s": np.round(p.time_s, 6)}
    for i, axle in enumerate(campaign.vehicle.axles):
        columns[f"station{i + 1}_m"] = np.round(p.speed_m_s * p.time_s - axle.x_m, 6)
        for key, force in (("q05", p.tire_force_q05_N), ("q50", p.tire_force_q50_N), ("q95", p.tire_force_q95_N)):
            columns[f"force{i + 1}_N_{key}"] = (
                np.full(len(p.time_s), np.nan) if force is None else np.round(force[i], 2)
            )
    columns |= beyond_columns(p) | bet_column(p, judgement)
    import pandas as pd

    return pd.DataFrame(columns).to_csv(index=False, lineterminator="\n")
