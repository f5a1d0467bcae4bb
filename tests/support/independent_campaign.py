"""Campaign folders of independent trucks: scan, logs, campaign.toml."""

from __future__ import annotations

from itertools import cycle, product
from pathlib import Path

import numpy as np
from campaign_files import HEADING_DEG, sensor_columns, write_log, write_scan
from independent_motion import INTERVAL_S, LENGTH_M, height, simulate
from independent_truck import Elements, IndependentTruck
from scipy.signal import lfilter

NOISE = {"lvdt": 2.5e-4, "axle": 0.25, "frame": 0.15}


def write_truck_campaign(
    folder: Path,
    truck: IndependentTruck,
    *,
    declare: str = "",
    bending: str = "",
    speeds=(8.0, 16.0, 24.0),
    changes=(0.0,),
    load_shift: bool = False,
    of_runs: str = "",
    predicted: tuple[tuple[str, float], ...] = (),
    written: IndependentTruck | None = None,
    correlation: float = 0.0,
    outliers: float = 0.0,
    seed: int = 1,
) -> dict[str, tuple[float, float]]:
    """A campaign folder with a scan and one run per load case and speed [km/h].

    `declare` is text after the axles, such as a group; `bending` a key of the last body; `changes` of the speed over a
    passage are taken by the runs in turn, `load_shift` as in :func:`simulate`; `of_runs` a key of every run, and
    `predicted` passes as (load case, speed [km/h]); `written` what the campaign file says of the truck, if not the
    truth; `correlation` of successive noise values, `outliers` share of readings that are six times the noise off.
    Returns speed at axle 1 [m/s] and its change by the file of a run.
    """
    rng = np.random.default_rng(seed)
    (folder / "bump_runs").mkdir(parents=True, exist_ok=True)
    write_scan(folder / "bump_scan.csv", lambda s: np.asarray(height(s)), 0.5 * LENGTH_M, 20_000, 0.0015, rng)
    runs = [
        (case, v / 3.6 * (1.0 + 0.01 * rng.normal()), rng.uniform(0.7, 1.2), change, v)
        for (case, v), change in zip(product(truck.load_cases, speeds), cycle(changes))
    ]
    length = [r[2] + (truck.x_m[-1] + LENGTH_M) / (r[1] * (1.0 + min(r[3], 0.0))) + 2.0 for r in runs]
    clean = simulate(truck, [r[:4] for r in runs], max(length), load_shift=load_shift)
    columns, kinds = sensor_columns(len(truck.x_m))
    sd = np.array([NOISE[k] for k in kinds])
    lines, driven = [], {}
    for r, (case, speed, _, change, v) in enumerate(runs):
        file = f"bump_runs/{case}_{v:g}.csv"
        values = clean[: int(length[r] / INTERVAL_S), r, : sd.size]
        gain = 1.0 + 0.003 * rng.normal(size=sd.size)
        noise = noise_of(rng, values.shape, correlation, outliers)
        values = gain * values + sd * (noise + 4.0 * rng.uniform(-1.0, 1.0, sd.size))
        write_log(folder / file, INTERVAL_S, columns, kinds, values)
        driven[file] = speed, change
        key = f", {of_runs}" if of_runs else ""
        lines.append(
            f'  {{ case = "{case} {v:g}", file = "{file}", load_case = "{case}", nominal_speed_km_h = {v:g}{key} }},'
        )
    passes = [f'  {{ load_case = "{case}", speed_km_h = {v:g} }},' for case, v in predicted]
    text = campaign_text(written or truck, declare, bending, lines, passes)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return driven


def noise_of(rng: np.random.Generator, shape: tuple[int, ...], correlation: float, outliers: float) -> np.ndarray:
    """Noise of unit variance along the first axis, some readings six standard deviations off."""
    white = rng.normal(size=shape)
    noise = white
    if correlation:
        noise = lfilter([np.sqrt(1.0 - correlation**2)], [1.0, -correlation], white, axis=0)
    return noise + 6.0 * rng.choice([-1.0, 1.0], size=shape) * (rng.random(shape) < outliers) if outliers else noise


def campaign_text(
    truck: IndependentTruck,
    declare: str,
    bending: str,
    runs: list[str],
    passes: list[str],
    drives: list[str] | None = None,
) -> str:
    """The campaign file; it names a scan if there are runs."""
    lines = [
        "schema = 1",
        "",
        "[campaign]",
        'title = "Synthetic campaign of an independent truck"',
        "synthetic = true",
        "",
        "[vehicle]",
    ]
    lines += ['name = "independent truck"', ""]
    for b in range(truck.bodies):
        lines += ["[[vehicle.body]]", f'name = "body {b + 1}"']
        if b:
            lines += [f"hitch_x_m = {truck.hitch[b - 1][0]}", f"hitch_height_m = {truck.hitch[b - 1][1]}"]
        if b == truck.bodies - 1 and bending:
            lines.append(bending)
        lines.append("")
    each = truck.elements or (Elements(),) * len(truck.x_m)
    for i, x in enumerate(truck.x_m):
        lines += [
            "[[vehicle.axle]]",
            f'name = "axle {i + 1}"',
            f'body = "body {truck.body[i] + 1}"',
            f"x_m = {x}",
            f"unsprung_mass_kg = {truck.unsprung_kg[i]}",
            f"tire_stiffness_N_per_m = {truck.tire_N_per_m[i]}",
            f"tire_damping_N_s_per_m = {truck.tire_N_s_per_m[i]}",
            f"tire_radius_m = {truck.radius_m[i]}",
            f'suspension = "{truck.suspension[i]}"',
            f"load_dependent = {str(each[i].load_exponent > 0.0).lower()}",
            *_travels(each[i]),
            "",
        ]
    lines += [declare, ""]
    for case, (loads, sprung, inertia, tall) in truck.load_cases.items():
        lines += [
            f"[load_case.{case}]",
            f"axle_loads_kg = {list(loads)}",
            f"sprung_mass_kg = {list(sprung)}",
            f"pitch_inertia_kg_m2 = {list(inertia)}",
            f"cg_height_m = {list(tall)}",
            "",
        ]
    lines += ["[acquisition]", f"sample_interval_s = {INTERVAL_S}", "", "[sensors.bump_run]"]
    columns, kinds = sensor_columns(len(truck.x_m))
    for k, (column, kind) in enumerate(zip(columns, kinds, strict=True)):
        i = k % len(truck.x_m)
        if kind == "frame":
            place = f'kind = "body_acceleration", body = "body {truck.body[i] + 1}", x_m = {truck.x_m[i]}, unit = "g"'
        else:
            what, unit = ("suspension_deflection", "mm") if kind == "lvdt" else ("axle_acceleration", "g")
            place = f'kind = "{what}", axle = "axle {i + 1}", unit = "{unit}"'
        lines.append(f"{column} = {{ {place} }}")
    if runs:
        lines += ["", "[scan]", 'file = "bump_scan.csv"', f"heading_deg = {HEADING_DEG}"]
    lines += ["", "[tests]"]
    for name, entries in (("bump_run", runs), ("road_drive", drives or []), ("prediction", passes)):
        lines += [f"{name} = [", *entries, "]"] if entries else []
    return "\n".join([*lines, ""])


def _travels(element: Elements) -> list[str]:
    if element.jounce_m >= 1.0 or not element.declared:
        return []
    return [f"jounce_travel_m = {element.jounce_m}", f"rebound_travel_m = {element.rebound_m}"]
