"""Writes the planned campaigns beside it from the vehicle templates of `init`.

python examples/vehicles/make_examples.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sysid.first_look import Template, template
from sysid.first_look.templates import template_text

FOLDER = Path(__file__).resolve().parent
NAMES = ("rigid3", "semitrailer5")
SPEEDS_KM_H = (9, 16, 24)
#: A raised-cosine bump [m], and points of its scan.
HEIGHT_M, LENGTH_M, POINTS = 0.075, 0.9, 2500


def scan(seed: int) -> str:
    """A point cloud of the bump with a metre of road before and behind it; the truck drives along +x."""
    rng = np.random.default_rng(seed)
    along, across = rng.uniform(-1.6, 1.6, POINTS), rng.uniform(-1.4, 1.4, POINTS)
    inside = np.abs(along) < 0.5 * LENGTH_M
    z = np.where(inside, 0.5 * HEIGHT_M * (1.0 + np.cos(2.0 * np.pi * along / LENGTH_M)), 0.0)
    z += 0.0015 * rng.normal(size=POINTS)
    rows = "\n".join(f"{x:.3f},{y:.3f},{h:.4f}" for x, y, h in zip(along, across, z, strict=True))
    return f"x_m,y_m,z_m\n{rows}\n"


def sensors(chosen: Template) -> list[str]:
    """Deflection, axle and frame acceleration at every axle."""
    result = ["[sensors.bump_run]"]
    for i, axle in enumerate(chosen.axles, start=1):
        name, body, x_m = axle["name"], axle["body"], axle["x_m"]
        result += [
            f'lvdt{i}_mm = {{ kind = "suspension_deflection", axle = "{name}", unit = "mm", range = 150 }}',
            f'axle{i}_accel_g = {{ kind = "axle_acceleration", axle = "{name}", unit = "g", range = 25 }}',
            f'frame{i}_accel_g = {{ kind = "body_acceleration", body = "{body}", x_m = {x_m}, unit = "g", range = 5 }}',
        ]
    return result


def campaign(name: str) -> str:
    """The campaign file of a template: every load case at every speed, twice."""
    chosen, text = template(name), template_text(name)
    runs = [
        f'  {{ case = "{case} {speed} km/h", file = "bump_runs/{case}_{speed}kmh_run{repeat}.csv", '
        f'load_case = "{case}", nominal_speed_km_h = {speed}, repeat = {repeat} }},'
        for case in chosen.load_cases
        for speed in SPEEDS_KM_H
        for repeat in (1, 2)
    ]
    passes = ", ".join(f'{{ load_case = "{case}", speed_km_h = 40 }}' for case in chosen.load_cases)
    lines = [
        f"# Planned campaign of the template {name}: nothing has been driven yet.",
        f"#     python calibrate.py selftest examples/vehicles/{name}",
        "# says what these runs and sensors would teach.  All numbers of the vehicle are assumed.",
        "schema = 1",
        "",
        "[campaign]",
        f'title = "Planned campaign: {name}"',
        "",
        text[text.index("[vehicle]\n") :],
        "[acquisition]",
        "sample_interval_s = 0.005",
        'filter = { type = "butterworth", order = 4, cutoff_hz = 60 }',
        "",
        *sensors(chosen),
        "",
        "[scan]",
        'file = "bump_scan.csv"',
        "heading_deg = 0",
        "",
        "[tests]",
        "bump_run = [",
        *runs,
        "]",
        f"prediction = [{passes}]",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for number, name in enumerate(NAMES):
        (FOLDER / name).mkdir(exist_ok=True)
        (FOLDER / name / "campaign.toml").write_text(campaign(name), encoding="utf-8")
        (FOLDER / name / "bump_scan.csv").write_text(scan(number), encoding="utf-8")
