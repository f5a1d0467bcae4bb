"""The folder of a campaign: logs, scan, `campaign.toml` as a careful engineer writes it, and `truth.json`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d
from scipy.signal import bessel, butter, lfilter, sosfilt

from studies.made_trucks.contact import Contact, Profile, cams, spokes
from studies.made_trucks.draw import Campaign, Measuring
from studies.made_trucks.motion import (
    ROUGH_STEP_M,
    SETTLE_S,
    Equations,
    History,
    Lane,
    Rows,
    simulate,
    tire_constants,
)
from studies.made_trucks.truck import GRAVITY, Array, Truck

SPEEDS_KM_H = (8.0, 16.0, 24.0)
PASSES = (("empty", 48.0), ("laden", 32.0))
PLANK_M = 0.075
STEP_S = 5e-4
_G_UNIT = 9.80665
_BEFORE_S, _AFTER_S = 1.2, 2.2  # before axle 1 meets the bump, after the last axle has left it
_SKIP_S = 0.9  # in which the road grows rough
_DROP_S = 3.5


def make(campaign: Campaign, folder: Path, rng: np.random.Generator, step_s: float = STEP_S) -> None:
    """Simulate all runs and write the folder."""
    truck = campaign.truck
    (folder / "bump_runs").mkdir(parents=True)
    if campaign.drops:
        (folder / "plank_drops").mkdir()
    contact = make_contact(campaign)
    runs, labels = _runs(campaign, rng)
    passes = [_pass(truck, case, speed, campaign) for case, speed in PASSES]
    histories = _simulate(truck, runs + passes, contact, campaign.bump.length_m, step_s)
    speeds, gains = {}, dict[str, float]()
    for lane, (name, nominal), history in zip(runs, labels, histories[: len(runs)], strict=True):
        file = f"bump_runs/{name}.csv"
        _write_run(campaign, lane, history, folder / file, rng, gains)
        speeds[file] = (truck.load_cases[lane.case].name, nominal)
    peaks = []
    for lane, history in zip(passes, histories[len(runs) :], strict=True):
        load = history.wheel_load_n.reshape(-1, truck.axles, 2).sum(axis=2)
        peaks.append((load.max(axis=0) / (GRAVITY * truck.load_cases[lane.case].axle_load_kg)).tolist())
    drops = _write_drops(campaign, contact, folder, rng, step_s) if campaign.drops else []
    heading = _write_scan(campaign, folder / "bump_scan.csv", rng)
    (folder / "campaign.toml").write_text(_declare(campaign, speeds, drops, heading, rng), encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(_truth(truck, peaks), indent=1), encoding="utf-8")


def make_contact(campaign: Campaign) -> Contact:
    """Tables of left wheel track, right wheel track and plank edge."""
    truck, bump = campaign.truck, campaign.bump
    side = float(np.mean(truck.track_m)) / 2.0

    def along(y_m: float) -> Profile:
        return lambda s: bump.driven(s, np.full_like(s, y_m))

    def plank(station_m: Array) -> Array:
        return np.where(station_m < 0.0, PLANK_M, 0.0)

    profiles = [along(side), along(-side), plank]
    if campaign.contact == "cams":
        # Spacing 0.8 times the length of contact (Schmeitz).
        static = float(np.mean(truck.wheels(GRAVITY * truck.load_cases[0].axle_load_kg) / tire_constants(truck)[0]))
        length = 2.0 * np.sqrt(2.0 * truck.radius_m * static ** (1.0 / truck.tire_exponent))
        return cams(profiles, bump.length_m, truck.radius_m, 0.8 * min(float(length), 0.25))
    return spokes(profiles, bump.length_m, truck.radius_m, truck.tire_exponent)


def _runs(campaign: Campaign, rng: np.random.Generator) -> tuple[list[Lane], list[tuple[str, float]]]:
    truck = campaign.truck
    lanes: list[Lane] = []
    labels = []
    for case, of in enumerate(truck.load_cases):
        for nominal in SPEEDS_KM_H:
            speed = nominal / 3.6 * float(1.0 + 0.02 * np.clip(rng.standard_normal(), -2.5, 2.5))
            before = _BEFORE_S + float(rng.uniform(0.0, 0.6))
            n = len(lanes)
            lane = Lane(
                case,
                speed,
                -before * speed - 0.4,
                profile=(0, 1),
                skew_rad=campaign.bump.skew_rad,
                damper_scale=campaign.damper_scales[n],
            )
            if campaign.roughness_m3 > 0.0:
                reach = truck.axle_x_m[-1] + 2.0
                start = lane.station_m - reach
                length = campaign.bump.length_m + 2.0 * reach + speed * (before + _AFTER_S) + 6.0
                lane = replace(lane, rough=_rough(campaign.roughness_m3, length, rng), rough_from_m=start)
            lanes.append(lane)
            labels.append((f"{of.name}_{nominal:.0f}", nominal))
    return lanes, labels


def _pass(truck: Truck, name: str, speed_km_h: float, campaign: Campaign) -> Lane:
    case = [of.name for of in truck.load_cases].index(name)
    speed = speed_km_h / 3.6
    return Lane(case, speed, -0.6 * speed - 0.4, profile=(0, 1), skew_rad=campaign.bump.skew_rad)


def _rough(density_m3: float, length_m: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Left and right tracks of density G (n / 0.1)^-2, alike in long waves (ISO 8608; Cebon: coherence of tracks)."""
    count = round(length_m / ROUGH_STEP_M)
    n = np.fft.rfftfreq(count, ROUGH_STEP_M)
    amplitude = np.zeros_like(n)
    # Waves shorter than a footprint are filtered by the tire; longer than 20 m are felt as slope only.
    inside = (n > 0.05) & (n < 4.0)
    amplitude[inside] = np.sqrt(density_m3 * (n[inside] / 0.1) ** -2 * count / (2.0 * ROUGH_STEP_M))
    common = 1.0 / (1.0 + (n / 0.3) ** 2)
    parts = [(rng.standard_normal(n.size) + 1j * rng.standard_normal(n.size)) / np.sqrt(2.0) for _ in range(3)]
    tracks = (np.sqrt(common) * parts[0] + np.sqrt(1.0 - common) * own for own in parts[1:])
    left, right = (gaussian_filter1d(np.fft.irfft(amplitude * track, count), 0.08 / ROUGH_STEP_M) for track in tracks)
    return left, right


def _simulate(truck: Truck, lanes: list[Lane], contact: Contact, bump_m: float, step_s: float) -> list[History]:
    """Histories of the lanes, each until its last axle is far behind the bump; lanes of similar length together."""
    needs = [(bump_m - n.station_m + truck.axle_x_m[-1]) / n.speed_m_s + _AFTER_S for n in lanes]
    order = np.argsort(needs)
    found: dict[int, History] = {}
    for group in np.array_split(order, 2):
        equations = Equations(truck, [lanes[i] for i in group], contact)
        whole = simulate(equations, max(needs[i] for i in group), step_s)
        for place, i in enumerate(group):
            found[int(i)] = _of_lane(whole, place, round(needs[i] / step_s))
    return [found[i] for i in range(len(lanes))]


def _of_lane(whole: History, lane: int, steps: int) -> History:
    return History(
        whole.time_s[:steps],
        whole.position[:steps, lane],
        whole.acceleration[:steps, lane],
        whole.wheel_load_n[:steps, lane],
    )


def _columns(campaign: Campaign, axles: list[int]) -> list[tuple[str, str, int, float, int]]:
    """Name, kind, axle, place across and number of the kind of every sensor."""
    m = campaign.measuring
    found = []
    for number, (kind, name) in enumerate(
        (("suspension_deflection", "lvdt"), ("axle_acceleration", "axle_acc"), ("body_acceleration", "frame_acc"))
    ):
        for axle in axles:
            for side in m.sides:
                end = "" if len(m.sides) == 1 else ("_left" if side > 0 else "_right")
                found.append((f"{name}{axle + 1}{end}", kind, axle, side * m.places_m[number], number))
    return found


def _read(
    campaign: Campaign,
    case: int,
    history: History,
    columns: list[tuple[str, str, int, float, int]],
    sample_s: float,
    rng: np.random.Generator,
    gains: dict[str, float],
) -> pd.DataFrame:
    """Readings of sensors: filter, gain, offset, noise, range, rounding."""
    m, rows = campaign.measuring, Rows(campaign.truck, case)
    step = float(history.time_s[1] - history.time_s[0])
    time = np.arange(history.time_s[0] + rng.uniform(0.0, sample_s), history.time_s[-1], sample_s)
    table = {"time_s": np.round(np.arange(time.size) * sample_s, 6)}
    for name, kind, axle, y, number in columns:
        if kind == "suspension_deflection":
            signal = history.position @ (rows.deflection(axle, y) @ rows.basis)
        else:
            row = rows.axle_up(axle, y) if kind == "axle_acceleration" else rows.body_up(axle, y)
            signal = history.acceleration @ (row @ rows.basis)
        signal = np.interp(time, history.time_s, _filtered(m, signal, step))
        white = m.noise[number] * rng.standard_normal(time.size)
        slow = lfilter([1.0], [1.0, -np.exp(-sample_s / 0.1)], rng.standard_normal(time.size + 500))[500:]
        slow *= m.drift * m.noise[number] * np.sqrt(1.0 - np.exp(-2.0 * sample_s / 0.1))
        unit = (1e3, 1.0 / _G_UNIT, 1.0 / _G_UNIT)[number]
        offset = rng.normal(0.0, (2.0, 0.03, 0.03)[number])
        gain = gains.setdefault(f"{name}", float(1.0 + m.gain_sd * rng.standard_normal()))
        full = (150.0, m.axle_range_g, 5.0)[number]
        reading = gain * unit * (signal + white + slow) + offset
        table[name] = np.clip(np.round(reading, (2, 4, 4)[number]), -full, full)
    return pd.DataFrame(table)


def _filtered(m: Measuring, signal: Array, step_s: float) -> Array:
    if m.filter_type == "bessel":
        # The cut-off is the point of -3 dB.
        sos = bessel(m.filter_order, m.filter_cutoff_hz, fs=1.0 / step_s, output="sos", norm="mag")
    else:
        sos = butter(m.filter_order, m.filter_cutoff_hz, fs=1.0 / step_s, output="sos")
    return np.asarray(sosfilt(sos, signal - signal[0]) + signal[0])


def _write_run(
    campaign: Campaign, lane: Lane, history: History, path: Path, rng: np.random.Generator, gains: dict[str, float]
) -> None:
    m = campaign.measuring
    keep = history.time_s >= _SKIP_S
    history = History(
        history.time_s[keep], history.position[keep], history.acceleration[keep], history.wheel_load_n[keep]
    )
    columns = _columns(campaign, list(range(campaign.truck.axles)))
    table = _read(campaign, lane.case, history, columns, m.sample_s, rng, gains)
    if m.lost and rng.random() < m.lost / 3.0:
        name, start = str(rng.choice(np.array(table.columns[1:], dtype=str))), int(rng.integers(len(table) // 2))
        table.loc[start : start + int(rng.uniform(0.05, 0.4) / m.sample_s), name] = np.nan
    for _ in range(rng.poisson(m.spikes) if m.spikes else 0):
        name = str(rng.choice(np.array(table.columns[1:], dtype=str)))
        scale = table[name].abs().max()
        table.loc[int(rng.integers(len(table))), name] = float(
            np.round(scale * rng.choice([-1.0, 1.0]) * rng.uniform(1, 4), 3)
        )
    table.to_csv(path, index=False)


def _write_drops(
    campaign: Campaign, contact: Contact, folder: Path, rng: np.random.Generator, step_s: float
) -> list[tuple[int, str, float]]:
    truck = campaign.truck
    lanes = [
        Lane(0, float(rng.uniform(1.0, 1.6)), truck.axle_x_m[axle] - 0.35, (2, 2), plank_axle=axle, plank_m=PLANK_M)
        for axle in range(truck.axles)
    ]
    whole = simulate(Equations(truck, lanes, contact), SETTLE_S + _DROP_S, step_s)
    found, gains = [], dict[str, float]()
    for axle, lane in enumerate(lanes):
        history = _of_lane(whole, axle, whole.time_s.size)
        keep = history.time_s >= SETTLE_S - 0.6
        history = History(
            history.time_s[keep], history.position[keep], history.acceleration[keep], history.wheel_load_n[keep]
        )
        columns = [c for c in _columns(campaign, [axle]) if c[3] * campaign.measuring.sides[0] > 0]
        table = _read(campaign, 0, history, columns, 0.005, rng, gains)
        table.columns = ["time_s", "frame_axle_mm", "axle_acc_g", "frame_acc_g"]
        file = f"plank_drops/axle{axle + 1}.csv"
        table.to_csv(folder / file, index=False)
        found.append((axle, file, round(3.6 * lane.speed_m_s, 0)))
    return found


def _write_scan(campaign: Campaign, path: Path, rng: np.random.Generator) -> float:
    """Points of the bump and a metre of road around it, in the axes of a scanner; returns the true heading [deg]."""
    bump, m = campaign.bump, campaign.measuring
    count = m.scan_points
    s, y = rng.uniform(-1.2, bump.length_m + 1.2, count), rng.uniform(-1.7, 1.7, count)
    z = bump.scanned(s - y * np.tan(bump.skew_rad), y) + rng.normal(0.0, m.scan_noise_m, count)
    out = rng.random(count) < 0.003
    z[out] += rng.uniform(-0.3, 0.6, int(out.sum()))
    z += rng.normal(0.0, 0.005) * s + rng.normal(0.0, 0.01) * y - 0.3
    heading = float(rng.uniform(-180.0, 180.0))
    turn = np.deg2rad(heading)
    x0, y0 = rng.uniform(-5.0, 5.0, 2)
    points = np.column_stack([x0 + s * np.cos(turn) - y * np.sin(turn), y0 + s * np.sin(turn) + y * np.cos(turn), z])
    pd.DataFrame(np.round(points, 4), columns=["x_m", "y_m", "z_m"]).to_csv(path, index=False)
    return heading


def _normal(rng: np.random.Generator, sd: float, size: int | None = None) -> Array:
    """Errors of declared values; those beyond 2.5 standard deviations would be noticed."""
    return np.asarray(sd * np.clip(rng.standard_normal(size), -2.5, 2.5))


def _declare(
    campaign: Campaign,
    runs: dict[str, tuple[str, float]],
    drops: list[tuple[int, str, float]],
    heading_deg: float,
    rng: np.random.Generator,
) -> str:
    t, sd, m = campaign.truck, campaign.knowledge.sd, campaign.measuring
    exact = not any(sd.values())
    names = [f"axle {a + 1}" for a in range(t.axles)]
    bodies = ["truck"] if len(t.load_cases[0].body_mass_kg) == 1 else ["tractor", "trailer"]
    tolerances = {n: 0.0 if exact else float(f"{v / campaign.knowledge.ratio[n]:.2g}") for n, v in sd.items()}
    if len(bodies) == 1:
        del tolerances["hitch_height"]
    unsprung = t.unsprung_kg * (1.0 + _normal(rng, sd["unsprung_mass"], t.axles))
    tire = t.tire_stiffness_n_per_m * (1.0 + (0.0 if exact else _normal(rng, 0.06, t.axles)))  # data sheets
    tire_c = t.tire_damping_n_s_per_m * np.exp(0.0 if exact else _normal(rng, 0.35))
    hitch_m = t.hitch_height_m * (1.0 + float(_normal(rng, sd["hitch_height"])))
    scale = 1.0 + float(_normal(rng, sd["axle_load_scale"]))
    pitch_error = np.exp(_normal(rng, sd["pitch_inertia"], 3))
    height_error = 1.0 + _normal(rng, sd["cg_height"], 3)
    digits = 6 if exact else 0
    lines = [
        "schema = 1",
        "",
        "[campaign]",
        'title = "Made truck"',
        "synthetic = true",
        "",
        "[vehicle]",
        'name = "truck"',
    ]
    lines.append("tolerances = { " + ", ".join(f"{n} = {v}" for n, v in tolerances.items()) + " }")
    for b, name in enumerate(bodies):
        lines += ["", "[[vehicle.body]]", f'name = "{name}"']
        if b:
            lines += [f"hitch_x_m = {t.hitch_x_m}", f"hitch_height_m = {hitch_m:.3f}"]
    for a, name in enumerate(names):
        lines += [
            "",
            "[[vehicle.axle]]",
            f'name = "{name}"',
            f'body = "{bodies[t.axle_body[a]]}"',
            f"x_m = {t.axle_x_m[a]}",
            f"unsprung_mass_kg = {unsprung[a]:.{digits}f}",
            f"tire_stiffness_N_per_m = {tire[a]:.{digits}f}",
            f"tire_damping_N_s_per_m = {tire_c[a]:.{digits}f}",
            f"tire_radius_m = {t.radius_m}",
            f'suspension = "{t.suspension[a]}"',
            f"track_m = {t.track_m[a]}",
            f"spring_track_m = {t.spring_track_m[a]}",
            f"damper_track_m = {t.damper_track_m[a]}",
        ]
        if t.track_m[a] > 1.9:
            lines.append("dual_spacing_m = 0")
    declared_unsprung = np.round(unsprung, digits)
    for n, of in enumerate(t.load_cases):
        read = of.axle_load_kg * scale * (1.0 + _normal(rng, sd["axle_load"], t.axles))
        read = np.round(read, 6 if exact else -1)
        sprung = [float(np.sum(read - declared_unsprung))]
        if len(bodies) > 1:
            on = np.array(t.axle_body) == 0
            # The tractor alone on the same scale.
            alone = (of.body_mass_kg[0] + np.sum(t.unsprung_kg[on])) * scale
            tractor = float(np.round(alone, 6 if exact else -1) - np.sum(declared_unsprung[on]))
            sprung = [tractor, sprung[0] - tractor]
        b = len(bodies)
        # The guess of a tractor is one for both load cases; that of a load changes.
        error = [0, 1 + n][:b] if b > 1 else [n]
        inertia = of.pitch_inertia_kg_m2 * pitch_error[error]
        height = of.cg_height_m * height_error[error]
        lines += [
            "",
            f"[load_case.{of.name}]",
            f"axle_loads_kg = {np.round(read, 6).tolist()}",
            f"sprung_mass_kg = {np.round(sprung, 6).tolist()}",
            f"pitch_inertia_kg_m2 = {np.round(inertia, -2 if not exact else 6).tolist()}",
            f"cg_height_m = {np.round(height, 2 if not exact else 6).tolist()}",
        ]
    lines += ["", "[acquisition]", f"sample_interval_s = {m.sample_s}"]
    lines.append(f'filter = {{ type = "{m.filter_type}", order = {m.filter_order}, cutoff_hz = {m.filter_cutoff_hz} }}')
    lines += ["", "[sensors.bump_run]"]
    units = ("mm", "g", "g")
    for name, kind, axle, y, number in _columns(campaign, list(range(t.axles))):
        full = (150.0, m.axle_range_g, 5.0)[number]
        lines.append(
            f'{name} = {{ kind = "{kind}", axle = "{names[axle]}", unit = "{units[number]}", '
            f"y_m = {y}, range = {full} }}"
        )
    if drops:
        lines += ["", "[sensors.plank_drop]"]
        for name, kind, number in (
            ("frame_axle_mm", "suspension_deflection", 0), ("axle_acc_g", "axle_acceleration", 1),
            ("frame_acc_g", "body_acceleration", 2),
        ):  # fmt: skip
            full = (150.0, m.axle_range_g, 5.0)[number]
            lines.append(f'{name} = {{ kind = "{kind}", unit = "{units[number]}", range = {full} }}')
    declared_heading = heading_deg + (0.0 if exact else m.heading_error_deg)
    lines += ["", "[scan]", 'file = "bump_scan.csv"', f"heading_deg = {declared_heading:.2f}"]
    lines += ["", "[tests]"]
    if drops:
        lines.append("plank_drop = [")
        lines += [
            f'  {{ axle = "{names[a]}", file = "{file}", plank_height_m = {PLANK_M}, nominal_speed_km_h = {v} }},'
            for a, file, v in drops
        ]
        lines.append("]")
    held = "servo" if t.speed_hold_s < 0.2 else "cruise"
    lines.append("bump_run = [")
    lines += [
        f'  {{ case = "{case} {speed:.0f} km/h", file = "{file}", load_case = "{case}", '
        f'nominal_speed_km_h = {speed}, speed_held = "{held}" }},'
        for file, (case, speed) in runs.items()
    ]
    lines += ["]", "prediction = ["]
    lines += [f'  {{ load_case = "{case}", speed_km_h = {speed} }},' for case, speed in PASSES]
    lines += ["]", ""]
    return "\n".join(lines)


def _truth(truck: Truck, peaks: list[list[float]]) -> dict[str, object]:
    """True values, as docs/conventions.md and docs/results.md define them."""
    factor, _ = tire_constants(truck)
    m = truck.tire_exponent
    load = truck.wheels(GRAVITY * truck.load_cases[0].axle_load_kg, truck.left_load_share)
    tangent = m * load * (factor / load) ** (1.0 / m)
    friction = np.broadcast_to(truck.friction_share, (truck.axles,)) * truck.spring_load_n(0)
    return {
        "stiffness": {of.name: of.stiffness_n_per_m.tolist() for of in truck.load_cases},
        "damping": truck.damping_n_s_per_m().tolist(),
        "tire_stiffness": tangent.reshape(-1, 2).sum(axis=1).tolist(),
        "tire_damping": truck.tire_damping_n_s_per_m.tolist(),
        "friction": friction.tolist(),
        "peaks": peaks,
    }
