"""Simulated wheel forces against those of another engine, at the true suspension of a synthetic campaign.

    python docs/check_forces.py CAMPAIGN_FOLDER [FORCE_FOLDER]

CAMPAIGN_FOLDER holds campaign.toml and truth.toml, FORCE_FOLDER (default: CAMPAIGN_FOLDER/true) the files
bump_runs/*.csv and predictions/*.csv with columns time_s and tire_force1_kN and so on.  Stiffness and damping are held
at the truth; tires, speeds and starts are estimated from the logs.  Prints per run and axle the relative RMS error of
the force, RMS(simulated - true) / RMS(true - static), after one shift in time per run.
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd

from sysid.campaign import check_quality, read_campaign
from sysid.campaign.priors import PriorOverride
from sysid.campaign.records import Campaign
from sysid.estimation.fit.least_squares import fit_bump_runs
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.parameters.axle_laws import axle_laws, law_inputs
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.prediction.predict_passes import predict
from sysid.road import analyse_scan, read_point_cloud
from sysid.runtime import configure
from sysid.vehicle_model.engine import Timing, wheel_road
from sysid.vehicle_model.passes import Pass, make_pass_batch

#: Width of a prior that holds a value.
HELD = 1e-5


def held_at_truth(campaign: Campaign, truth: list[dict]) -> Campaign:
    """The campaign with priors that hold every axle's stiffness and damping."""
    axles = []
    for axle, behind in zip(campaign.vehicle.axles, truth, strict=True):
        priors = dict(axle.priors)
        priors["stiffness"] = PriorOverride(behind["suspension_stiffness_N_per_m"], HELD)
        priors["damping"] = PriorOverride(behind["suspension_damping_N_s_per_m"], HELD)
        axles.append(replace(axle, priors=priors, load_dependent=False, suspension_law="linear"))
    return replace(campaign, vehicle=replace(campaign.vehicle, axles=tuple(axles)))


def errors(time_s: np.ndarray, force: np.ndarray, file: Path, around_s: float) -> np.ndarray:
    """Relative RMS error (axles,) of forces (n, axles) against a file, after the best shift near `around_s`."""
    true = pd.read_csv(file)
    names = [f"tire_force{i + 1}_kN" for i in range(force.shape[1])]
    t, y = true["time_s"].to_numpy(), true[names].to_numpy() * 1e3
    size = np.sqrt(((y - y[0]) ** 2).mean(axis=0))

    def at(shift: float) -> np.ndarray:
        ours = np.stack([np.interp(t, time_s + shift, f) for f in force.T], axis=1)
        return np.asarray(np.sqrt(((ours - y) ** 2).mean(axis=0)) / size)

    shifts = around_s + np.arange(-0.02, 0.0201, 0.0002)
    return min((at(s) for s in shifts), key=lambda e: float(e.max()))


def main() -> None:
    """Fit, simulate, compare."""
    configure()
    folder = Path(sys.argv[1])
    forces = Path(sys.argv[2]) if len(sys.argv) > 2 else folder / "true"
    truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))["axle"]
    campaign, _ = check_quality(read_campaign(folder, point_cloud_reader=read_point_cloud))
    campaign = held_at_truth(campaign, truth)
    profiles = {name: analyse_scan(scan).profile for name, scan in campaign.scans.items()}
    parameters = campaign_parameters(campaign, None)
    fit, state = fit_bump_runs(campaign, parameters, profiles, FitOptions(second_solver=False))
    off = max(abs(np.log(p.value / p.prior_median)) for p in fit.parameters if p.quantity in ("stiffness", "damping"))
    print(f"stiffness and damping held within {off:.1e} of the truth")
    point, roads = state.point, state.model.felt
    worst = []
    for number, run in enumerate(campaign.bump_runs):
        batch = make_pass_batch(campaign.vehicle, campaign.load_cases, roads, [Pass(run.load_case, run.bump)], [])
        laws = law_inputs(campaign.vehicle, parameters, batch, [run.load_case])
        timing = Timing(round(run.log.duration_s / 0.001), 0.001, 1)
        motion = point.motion.of([number]).along_road(batch.axle_x)
        road = wheel_road(batch.matrices, batch.road, batch.axle_x, motion, timing)
        suspension, tire = axle_laws(laws, jnp.asarray(point.log_parameters)[:, None])
        found = road.engine.histories(batch.matrices, suspension, tire, road, timing)
        force = np.asarray(found.tire_force)[:, 0, :, 0]
        e = errors(np.arange(timing.samples) * 0.001, force, forces / run.log.file, run.log.start_time_s)
        worst.append(e.max())
        print(f"{run.log.file}: " + " ".join(f"{100 * x:.2f}" for x in e) + " %")
    print(f"worst run and axle: {100 * max(worst):.2f} %")
    for p in predict(state, None, campaign.predictions).passes:
        file = forces / "predictions" / f"{p.load_case}_{3.6 * p.speed_m_s:.0f}kmh.csv"
        true = pd.read_csv(file)
        first = true["tire_force1_kN"].to_numpy()
        around = float(true["time_s"].to_numpy()[first.argmax()] - p.time_s[p.tire_force_q50_N[0].argmax()])
        e = errors(p.time_s, p.tire_force_q50_N.T, file, around)
        print(f"{file.name}: " + " ".join(f"{100 * x:.2f}" for x in e) + " %")


if __name__ == "__main__":
    main()
