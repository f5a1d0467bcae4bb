"""Logs of 5 kHz whose stamps have 1 ms, of a van with sensors left and right, a speed and a pressure: from the folder
of the logger to k and c per axle.

A rigid body whose pitch inertia is m1 m2 L^2 / (m1 + m2) is two quarter cars; `scipy` integrates them.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from sysid.campaign import read_campaign
from sysid.campaign.toml.todo import find_todos
from sysid.cli.main import cli
from sysid.sdof import analyse_drops

RATE_HZ, WHEELBASE_M, G = 5000.0, 4.2, 9.81
#: Sprung and unsprung mass [kg], stiffness [N/m], damping [N s/m], tire stiffness [N/m] of each axle.
AXLES = ((1800.0, 300.0, 150e3, 8e3, 8e5), (2600.0, 500.0, 240e3, 12e3, 1.6e6))
HEIGHT_M, LENGTH_M, START_M = 0.06, 1.0, 5.0


def _bump(station_m: np.ndarray) -> np.ndarray:
    inside = (station_m > 0.0) & (station_m < LENGTH_M)
    return np.where(inside, HEIGHT_M * np.sin(np.pi * np.clip(station_m, 0.0, LENGTH_M) / LENGTH_M), 0.0)


def _quarter_car(axle: int, road, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Deflection [m], acceleration of axle and of frame [m/s^2] over the road(t) [m], from rest on its first height."""
    body, wheel, k, c, tire = AXLES[axle]
    load = (body + wheel) * G

    def rates(t: float, y: np.ndarray) -> list[float]:
        spring = k * (y[0] - y[2]) + c * (y[1] - y[3])
        contact = max(0.0, load - tire * (y[2] - float(road(t))))
        return [y[1], -spring / body, y[3], (spring + contact - load) / wheel]

    first = float(road(0.0))
    done = solve_ivp(
        rates, (time[0], time[-1]), [first, 0.0, first, 0.0], t_eval=time, max_step=2e-3, rtol=1e-8, atol=1e-9
    )
    accelerations = np.array([rates(t, y) for t, y in zip(time, done.y.T, strict=True)])
    return done.y[0] - done.y[2], accelerations[:, 3], accelerations[:, 1]


def _write(path: Path, time: np.ndarray, axles: dict[int, tuple], speed_km_h: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns: dict[str, np.ndarray] = {"Time (s)": np.floor(1e3 * time + 1e-6) / 1e3}
    for axle, (q, a, b) in axles.items():
        for side, other in (("L", 1.01), ("R", 0.99)):
            corner = "FR"[axle] + side
            columns[f"{corner} Suspension travel (mm)"] = 1e3 * other * q + 0.02 * rng.normal(size=q.size)
            columns[f"{corner} Unsprung acceleration (g)"] = other * a / 9.80665 + 0.005 * rng.normal(size=q.size)
            columns[f"{corner} Sprung acceleration (g)"] = other * b / 9.80665 + 0.003 * rng.normal(size=q.size)
        if axle == 1:
            columns["Rear bellows pressure (bar)"] = 3.5 - 8.0 * q + 0.002 * rng.normal(size=q.size)
    columns["Vehicle speed (km/h)"] = speed_km_h + 0.05 * rng.normal(size=time.size)
    columns["Gearbox temperature (degC)"] = np.full(time.size, 62.0)
    path.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.5g")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the logger: two runs and one drop of each axle."""
    result = tmp_path_factory.mktemp("van")
    time = np.arange(int(4.5 * RATE_HZ)) / RATE_HZ
    for k, speed in enumerate((12.0, 18.0)):
        v = speed / 3.6
        roads = [lambda t, x=x, v=v: _bump(np.asarray(v * t - START_M - x)) for x in (0.0, WHEELBASE_M)]
        axles = {i: _quarter_car(i, road, time) for i, road in enumerate(roads)}
        _write(result / f"empty/bump {speed:g} kmh.csv", time, axles, speed, k)
    for axle, name in enumerate(("front", "rear")):
        moved = _quarter_car(axle, lambda t: 0.075 if t < 1.0 else 0.0, time)
        _write(result / f"empty/plank drop {name} axle.csv", time, {axle: moved}, 1.0, 10 + axle)
    station = np.linspace(-0.5, LENGTH_M + 0.5, 81)
    profile = pd.DataFrame({"station_m": station, "height_m": _bump(station)})
    profile.to_csv(result / "profile.csv", index=False)
    return result


FILLED = {
    "axle_loads_kg": "[2100, 3100]",
    "load_case": '"empty"',
    "plank_height_m": "0.075",
    "filter": None,
}


def _fill(text: str) -> str:
    """The file with the values that a person has: loads and plank, and the van in place of the template."""
    for todo in find_todos(tomllib.loads(text)):
        value = FILLED[str(todo.path[-1])]
        line = next(row for row in text.splitlines() if row.startswith(f"{todo.path[-1]} = ") and "TODO:" in row)
        text = text.replace(f"{line}\n", "" if value is None else f"{todo.path[-1]} = {value}\n", 1)
    inertia = AXLES[0][0] * AXLES[1][0] * WHEELBASE_M**2 / (AXLES[0][0] + AXLES[1][0])
    rows, axle = [], -1
    for row in text.splitlines():
        key = row.split(" = ")[0]
        axle += row == "[[vehicle.axle]]"
        if axle >= 0 and key in ("unsprung_mass_kg", "tire_stiffness_N_per_m"):
            row = f"{key} = {AXLES[axle][1 if key.startswith('u') else 4]}"
        elif key == "x_m":
            row = f"x_m = {axle * WHEELBASE_M}"
        elif key == "pitch_inertia_kg_m2":
            row = f"{key} = [{inertia}]"
        rows.append(re.sub(r"  # TODO confirm.*", "", row))
    return "\n".join(rows)


def test_a_van_at_5_khz_with_stamps_of_1_ms(folder: Path, tmp_path: Path) -> None:
    def run(*arguments: str | Path) -> str:
        found = CliRunner().invoke(cli, [str(a) for a in arguments])
        assert found.exit_code == 0, found.output
        return found.output

    shown = run("init", folder)
    table = shown[shown.index("Drops and runs") :].splitlines()[:6]
    assert all(len(line) <= 80 for line in table)
    assert [line.split() for line in table[2:]] == [
        ["drops,", "axle", "1", "1"],
        ["drops,", "axle", "2", "1"],
        ["runs,", "12", "km/h", "1"],
        ["runs,", "18", "km/h", "1"],
    ]
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    tables = tomllib.loads(text)
    assert tables["acquisition"]["sample_interval_s"] == pytest.approx(1.0 / RATE_HZ, rel=1e-6)
    names = [axle["name"] for axle in tables["vehicle"]["axle"]]
    sensors = tables["sensors"]["bump_run"]
    for column, sensor in sensors.items():
        if column[:2] in ("FL", "FR", "RL", "RR"):
            said = {"Susp": "suspension_deflection", "Unsp": "axle_acceleration", "Spru": "body_acceleration"}
            assert sensor["kind"] == said[column[3:7]]
            assert (sensor["axle"], sensor["side"]) == (
                names["FR".index(column[0])],
                {"L": "left", "R": "right"}[column[1]],
            )
            assert sensor["unit"] == ("mm" if "travel" in column else "g")
    pressure = sensors["Rear bellows pressure (bar)"]
    assert pressure == {"kind": "air_pressure", "axle": names[1], "unit": "bar"}
    assert sensors["Vehicle speed (km/h)"] == {"kind": "speed", "unit": "km/h"}
    assert sensors["Gearbox temperature (degC)"] == {"unused": "a temperature"}
    assert [run["nominal_speed_km_h"] for run in tables["tests"]["bump_run"]] == [12, 18]
    (folder / "campaign.toml").write_text(_fill(text), encoding="utf-8")
    checked = run("check", folder, "--output", tmp_path / "output")
    assert "TODO" not in checked
    assert "25 good, 0 usable with findings, 0 rejected" in checked
    # From rest on the scales and the motion behind a plank: the van's own k and c, the tire in series corrected.
    pooled = {(e.axle, e.method): e for e in analyse_drops(read_campaign(folder)).pooled}
    for axle, (_, _, k, c, _) in enumerate(AXLES):
        found = pooled[(axle, "corrected")]
        assert (found.stiffness, found.damping) == (pytest.approx(k, rel=0.02), pytest.approx(c, rel=0.03))
