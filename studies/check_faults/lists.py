"""Faults of what is written down: runs, places, masses, drops, and the scan of the bump."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pandas as pd

from studies.check_faults.made import (
    Copy,
    Fault,
    Made,
    an_axle,
    change_text,
    drop_lines,
    numbers_of,
    run_lines,
    swap,
)
from studies.faults.campaign_copy import CampaignCopy, DoesNotApply

_SPEED = r"nominal_speed_km_h = ([\d.]+)"


def speeds(factor: float, word: str) -> Fault:
    """All speeds stand in another unit, or are off."""

    def fault(c: Copy) -> Made:
        change_text(c, _SPEED, lambda m: f"nominal_speed_km_h = {float(m.group(1)) * factor:.4g}")
        return Made(f"speeds times {factor:.3g}", (word,))

    return fault


def speed_of_one(c: CampaignCopy) -> Made:
    """One run is listed with another speed."""
    line = c.pick(run_lines(c))
    file = re.findall(r'file = "([^"]+)"', line)[0]
    factor = float(c.rng.choice([0.67, 1.5]))
    wrong = re.sub(_SPEED, lambda m: f"nominal_speed_km_h = {float(m.group(1)) * factor:.3g}", line)
    c.write(c.text.replace(line, wrong))
    return Made(f"{file} listed at {factor:g} times its speed", (f"{re.escape(file)}.*km/h",))


def _load_cases(c: CampaignCopy) -> tuple[str, str]:
    names = sorted(set(re.findall(r'load_case = "([^"]+)"\s*, nominal', c.text)))
    if len(names) != 2:
        raise DoesNotApply("not two load cases")
    return names[0], names[1]


def load_cases_exchanged(c: CampaignCopy) -> Made:
    """All runs are listed under the other load case."""
    one, two = _load_cases(c)
    lines = run_lines(c)
    text = c.text
    for line in lines:
        text = text.replace(line, swap(c, line, f'load_case = "{one}"', f'load_case = "{two}"'))
    c.write(text)
    return Made("load cases of all runs exchanged", (r"load case",))


def load_case_of_one(c: CampaignCopy) -> Made:
    """One run is listed under the other load case."""
    one, two = _load_cases(c)
    line = c.pick(run_lines(c))
    file = re.findall(r'file = "([^"]+)"', line)[0]
    c.write(c.text.replace(line, swap(c, line, f'load_case = "{one}"', f'load_case = "{two}"')))
    return Made(f"{file} under the other load case", (f"{re.escape(file)}.*load case",))


def runs_exchanged(c: CampaignCopy) -> Made:
    """The files of two runs of different speed are exchanged."""
    lines = run_lines(c)
    speed = [re.findall(_SPEED, x)[0] for x in lines]
    one = int(c.rng.integers(len(lines)))
    two = int(c.rng.choice([k for k in range(len(lines)) if speed[k] != speed[one]]))
    files = [re.findall(r'file = "([^"]+)"', lines[k])[0] for k in (one, two)]
    c.write(swap(c, c.text, files[0], files[1]))
    words = tuple(f"{re.escape(f)}.*(km/h|load case)" for f in files)
    return Made(f"{files[0]} and {files[1]} exchanged", words)


def filter_wrong(c: CampaignCopy) -> Made:
    """The cut-off of the anti-alias filter is written down five times too low."""
    change_text(c, r"cutoff_hz = ([\d.]+)", lambda m: f"cutoff_hz = {float(m.group(1)) / 5.0:g}")
    return Made("filter at a fifth of its frequency", (r"filter|cut-off|cutoff",))


def heading(by: float) -> Fault:
    """The direction of travel is off."""

    def fault(c: Copy) -> Made:
        change_text(c, r"heading_deg = ([\d.]+)", lambda m: f"heading_deg = {float(m.group(1)) + by:g}")
        harmless = "a symmetric bump is the same from both sides" if by == 180.0 and c.symmetric else ""
        return Made(
            f"heading off by {by:g} degrees", (r"heading|crest|other direction|direction of travel",), harmless=harmless
        )

    return fault


def positions(factor: float) -> Fault:
    """All distances behind axle 1 are scaled."""

    def fault(c: Copy) -> Made:
        change_text(c, r"\b(x_m|hitch_x_m) = ([\d.]+)", lambda m: f"{m.group(1)} = {float(m.group(2)) * factor:.4g}")
        return Made(f"all positions times {factor:g}", (r"positions|x_m",))

    return fault


def one_axle_moved(by_m: float) -> Fault:
    """One axle stands elsewhere than it is listed, with its sensors."""

    def fault(c: CampaignCopy) -> Made:
        places = re.findall(r"(?m)^x_m = ([\d.]+)", c.text)
        place = c.pick([p for p in places if float(p) > 0.0])
        other = f"{float(place) + float(c.rng.choice([-by_m, by_m])):g}"
        change_text(c, rf"\bx_m = {re.escape(place)}(?=[\s,])", f"x_m = {other}")
        return Made(f"axle at {place} m listed at {other} m", (r"positions|x_m|place",))

    return fault


def drops_of_the_other_case(c: CampaignCopy) -> Made:
    """All drops are listed under the load case that is not theirs, the first one."""
    other = max(_load_cases(c), key=lambda name: re.search(rf"(?m)^\[load_cases?\.{name}\]", c.text).start())  # type: ignore[union-attr]
    text = c.text
    for line in drop_lines(c):
        text = text.replace(line, re.sub(r"(plank_height_m = [\d.]+)", rf'\1, load_case = "{other}"', line))
    c.write(text)
    return Made(f"drops listed as '{other}'", (r"drops of.*load case",))


def sensor_moved(c: CampaignCopy) -> Made:
    """A frame sensor is listed 1.5 m from where it is."""
    column = f"frame{an_axle(c)}_accel_g"
    found = re.findall(rf"(?m)^{column} .*x_m = ([\d.]+)", c.text)
    other = float(found[0]) + 1.5
    change_text(c, rf"^({column} .*x_m = )[\d.]+", lambda m: f"{m.group(1)}{other:g}")
    return Made(f"{column} listed 1.5 m away", (f"{column}.*(x_m|place|mounted|position)",), frozenset([column]))


def axles_from_the_rear(c: CampaignCopy) -> Made:
    """The list of axles and loads runs from the rear: places are measured from the last axle."""
    longest = max(float(p) for p in re.findall(r"(?m)^x_m = ([\d.]+)", c.text))

    def turned(m: re.Match[str]) -> str:
        return f"{m.group(1)} = {abs(round(longest - float(m.group(2)), 4)):g}"

    change_text(c, r"\b(x_m|hitch_x_m) = ([\d.]+)", turned)
    return Made("axles listed from the rear", (r"rear|order|reverse",))


def loads_in(factor: float, unit: str, keys: str) -> Fault:
    """Masses stand in another unit."""

    def fault(c: Copy) -> Made:
        def line(m: re.Match[str]) -> str:
            return m.group(1) + re.sub(r"\d+(?:\.\d+)?", lambda n: f"{float(n.group(0)) * factor:.6g}", m.group(2))

        change_text(c, rf"^((?:{keys}) = )(\[[^\]]*\]|[\d.]+)", line)
        return Made(f"{keys} in {unit}", (r"axle_loads_kg|sprung_mass_kg|unsprung_mass_kg|masses|pitch_inertia",))

    return fault


def two_loads_exchanged(c: CampaignCopy) -> Made:
    """The scale readings of two axles are exchanged in one load case."""
    lists = numbers_of(c, "axle_loads_kg")
    k = int(c.rng.integers(len(lists)))
    i, j = sorted(int(v) for v in c.rng.choice(len(lists[k]), 2, replace=False))
    new = list(lists[k])
    new[i], new[j] = new[j], new[i]
    if abs(new[i] / new[j] - 1.0) < 0.02:
        raise DoesNotApply("loads of the same size")
    count = 0

    def line(m: re.Match[str]) -> str:
        nonlocal count
        count += 1
        return m.group(0) if count - 1 != k else "axle_loads_kg = [" + ", ".join(f"{v:g}" for v in new) + "]"

    change_text(c, r"^axle_loads_kg = \[[^\]]*\]", line)
    return Made(
        f"loads of axles {i + 1} and {j + 1} exchanged in load case {k + 1}",
        (r"axle_loads_kg|axle loads|centre of gravity",),
    )


def inertia(factor: float) -> Fault:
    """The pitch inertias stand in another unit, or are wrong."""

    def fault(c: Copy) -> Made:
        def line(m: re.Match[str]) -> str:
            return m.group(1) + re.sub(r"\d+(?:\.\d+)?", lambda n: f"{float(n.group(0)) * factor:.6g}", m.group(2))

        change_text(c, r"^(pitch_inertia_kg_m2 = )(\[[^\]]*\])", line)
        return Made(f"pitch inertias times {factor:g}", (r"inertia",))

    return fault


def tires(factor: float) -> Fault:
    """The tire stiffness is that of one tire, or in another unit."""

    def fault(c: Copy) -> Made:
        change_text(
            c,
            r"^tire_stiffness_N_per_m = ([\d.]+)",
            lambda m: f"tire_stiffness_N_per_m = {float(m.group(1)) * factor:g}",
        )
        return Made(f"tire stiffness times {factor:g}", (r"tire_stiffness|tire stiffness|tires",))

    return fault


def drops_exchanged(far: bool) -> Fault:
    """The drops of two axles are listed under each other's name."""

    def fault(c: Copy) -> Made:
        names = c.axles()
        if far:
            i, j = 0, int(c.rng.integers(1, len(names)))
        else:
            i, j = 1, 2
        text = c.text
        for line in drop_lines(c):
            text = text.replace(line, swap(c, line, f'"{names[i]}"', f'"{names[j]}"'))
        c.write(text)
        words = (r"drops? of.*(exchanged|another axle)", r"listed under")
        return Made(f"drops of axles {i + 1} and {j + 1} exchanged", words)

    return fault


def one_drop_of_another(c: CampaignCopy) -> Made:
    """One drop is listed under another axle."""
    line = c.pick(drop_lines(c))
    names = c.axles()
    own = next(n for n in names if f'"{n}"' in line)
    other = c.pick([n for n in names if n != own])
    c.write(c.text.replace(line, line.replace(f'"{own}"', f'"{other}"')))
    file = re.findall(r'file = "([^"]+)"', line)[0]
    words = (f"{re.escape(file)}.*(axle|repeat|other drops)",)
    return Made(f"{file} of '{own}' listed under '{other}'", words)


def plank(factor: float) -> Fault:
    """The height of the plank is wrong."""

    def fault(c: Copy) -> Made:
        change_text(c, r"plank_height_m = ([\d.]+)", lambda m: f"plank_height_m = {float(m.group(1)) * factor:g}")
        return Made(f"plank height times {factor:g}", (r"plank",))

    return fault


def body_released(c: CampaignCopy) -> Made:
    """Drops off a plank are listed as a body that was let go."""
    change_text(c, r", plank_height_m = [\d.]+", ', release = "body"')
    return Made("drops listed as released bodies", (r"release|plank|let go",))


def _scan(what: str, words: str, change: Callable[[pd.DataFrame], pd.DataFrame], harmless: str = "") -> Fault:
    def fault(c: Copy) -> Made:
        path = c.folder / "bump_scan.csv"
        change(pd.read_csv(path)).to_csv(path, index=False, float_format="%.7g")
        return Made(what, (words,), harmless=harmless)

    return fault


def _longer(t: pd.DataFrame) -> pd.DataFrame:
    x = t["x_m"] - t["x_m"].median()
    y = t["y_m"] - t["y_m"].median()
    return t.assign(x_m=2.2 * x, y_m=2.2 * y, z_m=0.6 * t["z_m"])


def scan_mirrored(c: Copy) -> Made:
    """The scan is mirrored along the lane."""
    path = c.folder / "bump_scan.csv"
    t = pd.read_csv(path)
    angle = np.radians(float(re.findall(r"heading_deg = ([\d.]+)", c.text)[0]))
    along = t["x_m"] * np.cos(angle) + t["y_m"] * np.sin(angle)
    middle = float(np.median(along))
    t = t.assign(
        x_m=t["x_m"] - 2.0 * (along - middle) * np.cos(angle), y_m=t["y_m"] - 2.0 * (along - middle) * np.sin(angle)
    )
    t.to_csv(path, index=False, float_format="%.7g")
    harmless = "a symmetric bump is the same from both sides" if c.symmetric else ""
    return Made("scan mirrored along the lane", (r"direction|heading|mirror",), harmless=harmless)


FAULTS: dict[str, dict[str, Fault]] = {
    "runs": {
        "speeds in m/s": speeds(1.0 / 3.6, r"km/h.*m/s"),
        "speeds in mph": speeds(0.621371, r"km/h.*mph"),
        "speeds 10 % off": speeds(1.1, r"km/h|speed"),
        "speed of one run": speed_of_one,
        "load cases exchanged": load_cases_exchanged,
        "load case of one run": load_case_of_one,
        "runs exchanged": runs_exchanged,
        "heading off by 180 degrees": heading(180.0),
        "heading off by 10 degrees": heading(10.0),
        "filter five times too low": filter_wrong,
        "load cases exchanged, named files": load_cases_exchanged,
    },
    "geometry": {
        "positions times 0.93": positions(0.93),
        "positions in feet": positions(3.28084),
        "one axle 0.3 m off": one_axle_moved(0.3),
        "one axle 0.8 m off": one_axle_moved(0.8),
        "frame sensor 1.5 m off": sensor_moved,
        "axles from the rear": axles_from_the_rear,
    },
    "masses": {
        "axle loads in lb": loads_in(2.20462, "lb", "axle_loads_kg"),
        "axle loads in N": loads_in(9.81, "N", "axle_loads_kg"),
        "all masses in lb": loads_in(
            2.20462, "lb", "axle_loads_kg|sprung_mass_kg|unsprung_mass_kg|pitch_inertia_kg_m2|cargo_mass_kg"
        ),
        "two loads exchanged": two_loads_exchanged,
        "inertia in t m2": inertia(1e-3),
        "inertia ten times": inertia(10.0),
        "inertia a third": inertia(1.0 / 3.0),
        "stiffness of one tire": tires(0.25),
        "stiffness of a side": tires(0.5),
        "tire stiffness in N/mm": tires(1e-3),
    },
    "drops": {
        "drops of 2 and 3 exchanged": drops_exchanged(False),
        "drops of two axles exchanged": drops_exchanged(True),
        "one drop under another axle": one_drop_of_another,
        "plank in cm": plank(100.0),
        "plank twice": plank(2.0),
        "plank half": plank(0.5),
        "drops as released bodies": body_released,
        "drops of the other load case": drops_of_the_other_case,
        "drops of 2 and 3 exchanged, named files": drops_exchanged(False),
    },
    "scan": {
        "scan in mm": _scan(
            "scan in mm", r"unit", lambda t: t.assign(x_m=1e3 * t["x_m"], y_m=1e3 * t["y_m"], z_m=1e3 * t["z_m"])
        ),
        "scan twice as high": _scan("scan twice as high", r"scan|bump", lambda t: t.assign(z_m=2.0 * t["z_m"])),
        "scan half as high": _scan("scan half as high", r"scan|bump", lambda t: t.assign(z_m=0.5 * t["z_m"])),
        "scan mirrored": scan_mirrored,
        "scan upside down": _scan("scan upside down", r"z must point up|sign", lambda t: t.assign(z_m=-t["z_m"])),
        "scan of another bump": _scan("scan of a longer, lower bump", r"scan|bump", _longer),
        "scan 0.5 m higher": _scan(
            "heights of the scan 0.5 m higher", r"scan", lambda t: t.assign(z_m=t["z_m"] + 0.5), "the road is levelled"
        ),
    },
}
