"""The files of a synthetic campaign: campaign.toml, logs, scan and truth.toml as text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

#: Factor from SI to the unit in the log, and its decimals.
_UNITS = {"lvdt": (1e3, 2), "axle": (1.0 / 9.80665, 3), "frame": (1.0 / 9.80665, 3)}
HEADING_DEG = 12.0


def sensor_columns(axles: int) -> tuple[list[str], list[str]]:
    """Columns of a bump run in the order of the simulated channels, and the kind of each."""
    kinds = [k for k in ("lvdt", "axle", "frame") for _ in range(axles)]
    names = {"lvdt": "lvdt{}_mm", "axle": "axle{}_accel_g", "frame": "frame{}_accel_g"}
    return [names[k].format(i % axles + 1) for i, k in enumerate(kinds)], kinds


def write_log(path: Path, interval_s: float, columns: list[str], kinds: list[str], values: np.ndarray) -> None:
    """Write readings (T, C) in SI as a log in the sensors' units."""
    factors, decimals = zip(*(_UNITS[k] for k in kinds), strict=True)
    table = np.column_stack([np.arange(len(values)) * interval_s, values * np.array(factors)])
    np.savetxt(
        path, table, delimiter=",", header=",".join(["time_s", *columns]), comments="",
        fmt=["%.4f", *(f"%.{d}f" for d in decimals)],
    )  # fmt: skip


def write_scan(
    path: Path, height: Callable[[np.ndarray], np.ndarray], half_m: float, points: int, noise_m: float, rng
) -> None:
    """Write the point cloud of a straight bump on a plane with a little grade and camber."""
    along, across = rng.uniform(-half_m - 1.6, half_m + 1.6, points), rng.uniform(-1.6, 1.6, points)
    z = height(along) + 0.008 * along - 0.015 * across + noise_m * rng.normal(size=points)
    stray = rng.random(points) < 0.003
    z[stray] += rng.uniform(-0.1, 0.3, int(stray.sum()))
    turn = np.radians(HEADING_DEG)
    x, y = along * np.cos(turn) - across * np.sin(turn), along * np.sin(turn) + across * np.cos(turn)
    table = np.column_stack([x + 12.0, y - 7.0, z + 1.4])
    np.savetxt(path, table, delimiter=",", header="x_m,y_m,z_m", comments="", fmt="%.4f")


def campaign_text(example, physics, runs, drops) -> str:
    """The campaign file."""
    vehicle = example.vehicle
    law = physics.declared_law or physics.suspension_law
    tables = example.text
    if law:
        tables = tables.replace('\nsuspension = "', f'\nsuspension_law = "{law}"\nsuspension = "')
    spec = physics.filter
    lines = [
        "schema = 1",
        "",
        "[campaign]",
        f'title = "Synthetic campaign: {vehicle.name}"',
        "synthetic = true",
        "",
        tables,
        "[acquisition]",
    ]
    lines.append(f"sample_interval_s = {physics.sample_interval_s}")
    if spec is not None:
        lines.append(f'filter = {{ type = "{spec.kind}", order = {spec.order}, cutoff_hz = {spec.cutoff_hz:g} }}')
    lines += ["", "[sensors.bump_run]"]
    limits = {"lvdt": 1e3 * physics.deflection_range_m, "axle": physics.axle_range_g, "frame": physics.body_range_g}
    columns, kinds = sensor_columns(len(vehicle.axles))
    for k, (column, kind) in enumerate(zip(columns, kinds, strict=True)):
        axle = vehicle.axles[k % len(vehicle.axles)]
        lines.append(f"{column} = {{ {_place(kind, axle, vehicle)}, range = {limits[kind]:g} }}")
    lines += [
        "",
        "[sensors.plank_drop]",
        f'frame_axle_mm = {{ kind = "suspension_deflection", unit = "mm", range = {limits["lvdt"]:g} }}',
        f'axle_accel_g = {{ kind = "axle_acceleration", unit = "g", range = {limits["axle"]:g} }}',
        f'frame_accel_g = {{ kind = "body_acceleration", unit = "g", range = {limits["frame"]:g} }}',
        "",
        "[scan]",
        'file = "bump_scan.csv"',
        f"heading_deg = {HEADING_DEG}",
        "",
        "[tests]",
        "plank_drop = [",
        *(f'  {{ axle = "{d.label}", file = "{d.file}", plank_height_m = {physics.plank_height_m} }},' for d in drops),
        "]",
        "bump_run = [",
        *(
            f'  {{ case = "{r.label} {r.nominal_km_h:g} km/h", file = "{r.file}", load_case = "{r.label}", '
            f"nominal_speed_km_h = {r.nominal_km_h:g}, repeat = {r.repeat} }},"
            for r in runs
        ),
        "]",
        "prediction = [",
        *(
            f'  {{ load_case = "{case}", speed_km_h = {1.5 * max(physics.speeds_km_h):g} }},'
            for case in example.load_cases
        ),
        "]",
    ]
    return "\n".join(lines) + "\n"


def _place(kind: str, axle, vehicle) -> str:
    if kind == "frame":
        return f'kind = "body_acceleration", body = "{vehicle.bodies[axle.body].name}", x_m = {axle.x_m:g}, unit = "g"'
    what, unit = ("suspension_deflection", "mm") if kind == "lvdt" else ("axle_acceleration", "g")
    return f'kind = "{what}", axle = "{axle.name}", unit = "{unit}"'


def truth_text(truth, physics, runs, drops) -> str:
    """What is behind the logs, for checking results: parameters, masses, speeds and starts."""
    lines = [
        "# TRUE values behind this campaign: for checking results, never an input of the toolkit.",
        "",
        "[physics]",
    ]
    lines += [f"{k} = {_toml(v)}" for k, v in asdict(physics).items()]
    lines += ["", "[parameters]", *(f'"{name}" = {value!r}' for name, value in truth.values.items()), ""]
    lines += ["[masses]", f"unsprung_mass_kg = {_toml([a.unsprung_mass_kg for a in truth.vehicle.axles])}"]
    for name, case in truth.load_cases.items():
        lines.append(f'"sprung_mass_kg[{name}]" = {_toml(case.sprung_mass_kg)}')
        lines.append(f'"pitch_inertia_kg_m2[{name}]" = {_toml(case.pitch_inertia_kg_m2)}')
    for table, logs in (("bump_run", runs), ("plank_drop", drops)):
        for log in logs:
            lines += ["", f"[[{table}]]", f'file = "{log.file}"', f"speed_m_s = {log.speed_m_s!r}"]
            lines.append(f"start_s = {log.start_s!r}")
    return "\n".join(lines) + "\n"


def _toml(value) -> str:
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(float(value) if isinstance(value, float) else value)
