"""Faults of what is written down: masses, places, speeds, names, units."""

from __future__ import annotations

import re
from collections.abc import Callable

from studies.faults.campaign_copy import CampaignCopy, DoesNotApply

Fault = Callable[[CampaignCopy], str]


def _one(key: str, *factors: float) -> Fault:
    def fault(c: CampaignCopy) -> str:
        factor = float(c.rng.choice(factors))
        return "one " + c.rescale(key, lambda: factor, c.one_of(key))

    return fault


def _all(key: str, *factors: float) -> Fault:
    def fault(c: CampaignCopy) -> str:
        factor = float(c.rng.choice(factors))
        return "every " + c.rescale(key, lambda: factor)

    return fault


def _exchanged(c: CampaignCopy, text: str, one: str, two: str) -> None:
    mark = "\0"
    c.write(text.replace(one, mark).replace(two, one).replace(mark, two))


def axles_exchanged(c: CampaignCopy) -> str:
    """The places of two axles are exchanged."""
    places = re.findall(r"(?m)^x_m = ([\d.]+)$", c.text)
    one, two = c.two(places)
    _exchanged(c, c.text, f"\nx_m = {one}\n", f"\nx_m = {two}\n")
    return f"axle positions {one} and {two} m exchanged"


def axle_loads_exchanged(c: CampaignCopy) -> str:
    """Two readings of the scale are exchanged."""
    values = re.findall(r"axle_loads_kg = \[([^\]]*)\]", c.text)[0].split(", ")
    one, two = c.two(values)
    _exchanged(c, c.text, one, two)
    return f"axle loads {one} and {two} kg exchanged"


def load_cases_exchanged(c: CampaignCopy) -> str:
    """Runs of one load case are listed under the other."""
    of_run = re.compile(r'load_case = "([^"]+)"(\s*, nominal)')
    names = sorted({name for name, _ in of_run.findall(c.text)})
    if len(names) != 2:
        raise DoesNotApply("not two load cases")
    other = dict(zip(names, reversed(names), strict=True))
    c.write(of_run.sub(lambda m: f'load_case = "{other[m.group(1)]}"{m.group(2)}', c.text))
    return f"load cases {names[0]} and {names[1]} of the runs exchanged"


def loads_in_pounds(c: CampaignCopy) -> str:
    """Axle loads in lb."""
    return c.rescale("axle_loads_kg", lambda: 2.20462)


def masses_in_tonnes(c: CampaignCopy) -> str:
    """Sprung masses in tonnes."""
    return c.rescale("sprung_mass_kg", lambda: 1e-3)


def speed_of_one_run(c: CampaignCopy) -> str:
    """One run was driven at another speed than the list says."""
    factor = float(c.rng.choice([0.5, 0.8, 0.9, 1.1, 1.25, 2.0]))
    return "one " + c.rescale("nominal_speed_km_h", lambda: factor, c.one_of("nominal_speed_km_h"))


def heading_reversed(c: CampaignCopy) -> str:
    """The direction of travel points the other way."""
    c.write(re.sub(r"heading_deg = ([\d.]+)", lambda m: f"heading_deg = {float(m.group(1)) + 180.0:g}", c.text))
    return "heading off by 180 degrees"


def heading_off(c: CampaignCopy) -> str:
    """The direction of travel is off, up to across the road."""
    by = float(c.rng.choice([-30.0, 8.0, 20.0, 90.0]))
    c.write(re.sub(r"heading_deg = ([\d.]+)", lambda m: f"heading_deg = {float(m.group(1)) + by:g}", c.text))
    return f"heading off by {by:g} degrees"


def scan_in_mm(c: CampaignCopy) -> str:
    """Metres of the scan taken for millimetres."""
    text = c.text
    replaced = text.replace("heading_deg = ", 'unit = "mm"\nheading_deg = ', 1)
    c.write(text.replace('unit = "m"\n', 'unit = "mm"\n', 1) if '\nunit = "m"' in text else replaced)
    return "unit of the scan mm instead of m"


def unit_of_a_sensor(c: CampaignCopy) -> str:
    """One kind of sensor, or one sensor, in another unit than it says."""
    wrong = {"mm": ("m", "cm", "in"), "g": ("m/s^2", "mg")}
    lines = [x for x in c.text.splitlines() if re.search(r'unit = "(mm|g)"', x) and "kind" in x]
    line = c.pick(lines)
    unit = re.findall(r'unit = "(mm|g)"', line)[0]
    other = c.pick(list(wrong[unit]))
    if c.rng.random() < 0.5:
        c.write(c.text.replace(line, line.replace(f'unit = "{unit}"', f'unit = "{other}"')))
        return f"{line.split(' ')[0]} in {other} instead of {unit}"
    c.write(c.text.replace(f'unit = "{unit}"', f'unit = "{other}"'))
    return f"every sensor in {unit} as {other}"


def range_too_small(c: CampaignCopy) -> str:
    """The full scale of a sensor is given too small: all above counts as clipped."""
    factor = float(c.rng.choice([0.05, 0.1, 0.3]))
    return "one " + c.rescale("range", lambda: factor, c.one_of("range"))


def sampling_of_the_file(c: CampaignCopy) -> str:
    """The sample interval written down is not that of the logs."""
    factor = float(c.rng.choice([0.1, 0.5, 2.0, 10.0, 1000.0]))
    return c.rescale("sample_interval_s", lambda: factor)


def filter_wrong(c: CampaignCopy) -> str:
    """The anti-alias filter is another one."""
    factor = float(c.rng.choice([0.1, 0.3, 3.0, 1000.0]))
    return c.rescale("cutoff_hz", lambda: factor)


def drop_axle_wrong(c: CampaignCopy) -> str:
    """The drops of two axles are exchanged."""
    one, two = c.two(c.axles())
    old = re.findall(r"(?s)plank_drop = \[.*?\n\]", c.text)[0]
    new = old.replace(f'"{one}"', "\0").replace(f'"{two}"', f'"{one}"').replace("\0", f'"{two}"')
    c.write(c.text.replace(old, new))
    return f"drops of {one} and {two} exchanged"


def sensors_of_axles_exchanged(c: CampaignCopy) -> str:
    """The sensors of two axles are exchanged in the runs."""
    one, two = c.two(c.axles())
    old = c.text[c.text.index("[sensors.bump_run]") : c.text.index("[sensors.plank_drop]")]
    new = old.replace(f'"{one}"', "\0").replace(f'"{two}"', f'"{one}"').replace("\0", f'"{two}"')
    c.write(c.text.replace(old, new))
    return f"sensors of {one} and {two} exchanged"


def sensor_not_declared(c: CampaignCopy) -> str:
    """Sensors are missing from the list."""
    old = c.text[c.text.index("[sensors.bump_run]") : c.text.index("[sensors.plank_drop]")]
    lines = [x for x in old.splitlines() if "kind" in x]
    count = int(c.rng.choice([1, 3, max(len(lines) - 2, 1)]))
    gone = {lines[int(i)] for i in c.rng.choice(len(lines), count, replace=False)}
    c.write(c.text.replace(old, "\n".join(x for x in old.splitlines() if x not in gone) + "\n\n"))
    return f"{len(gone)} of {len(lines)} sensors of the runs not declared"


def runs_exchanged(c: CampaignCopy) -> str:
    """The files of two runs are exchanged."""
    one, two = c.two(c.files("bump_runs"))
    _exchanged(c, c.text, one, two)
    return f"{one} and {two} exchanged"


def same_file_twice(c: CampaignCopy) -> str:
    """One file stands for two runs."""
    one, two = c.two(c.files("bump_runs"))
    c.write(c.text.replace(one, two))
    return f"{two} also stands for {one}"


def few_runs(c: CampaignCopy) -> str:
    """Only one run, or only those of one load case, or no drops."""
    kind = c.pick(["one run", "no drops", "no runs", "first load case"])
    lines = c.text.splitlines()
    runs = [x for x in lines if "nominal_speed_km_h" in x and "file" in x]
    drops = [x for x in lines if "plank_height_m" in x and "file" in x]
    case = re.findall(r'load_case = "([^"]+)"', runs[0])[0]
    gone = {
        "one run": [x for x in runs if x != c.pick(runs)],
        "no drops": drops,
        "no runs": runs,
        "first load case": [x for x in runs if f'load_case = "{case}"' not in x],
    }[kind]
    c.write("\n".join(x for x in lines if x not in gone) + "\n")
    return f"left of the tests: {kind}"


BOOKKEEPING: dict[str, Fault] = {
    "sprung mass": _one("sprung_mass_kg", 0.9, 1.1, 1.5),
    "axle load": _one("axle_loads_kg", 0.8, 0.9, 1.1, 1.3),
    "axle loads exchanged": axle_loads_exchanged,
    "axle loads in lb": loads_in_pounds,
    "masses in tonnes": masses_in_tonnes,
    "unsprung mass": _one("unsprung_mass_kg", 0.3, 0.6, 1.5, 3.0),
    "pitch inertia": _one("pitch_inertia_kg_m2", 0.1, 0.5, 2.0, 10.0),
    "height of the centre of gravity": _one("cg_height_m", 0.3, 2.0, 1000.0),
    "axle positions exchanged": axles_exchanged,
    "axle position": _one("x_m", 0.8, 0.93, 1.07, 1.2),
    "axle positions in mm": _all("x_m", 1000.0),
    "speeds in mph": _all("nominal_speed_km_h", 0.621371),
    "speeds in m/s": _all("nominal_speed_km_h", 1.0 / 3.6),
    "speeds off": _all("nominal_speed_km_h", 0.85, 1.15, 0.5, 2.0),
    "speed of one run": speed_of_one_run,
    "load cases exchanged": load_cases_exchanged,
    "heading off by 180 degrees": heading_reversed,
    "heading off": heading_off,
    "scan in mm": scan_in_mm,
    "unit of a sensor": unit_of_a_sensor,
    "range too small": range_too_small,
    "sample interval": sampling_of_the_file,
    "filter": filter_wrong,
    "drop axle wrong": drop_axle_wrong,
    "plank height in mm": _all("plank_height_m", 1000.0),
    "plank height": _all("plank_height_m", 0.5, 1.5),
    "sensors of axles exchanged": sensors_of_axles_exchanged,
    "sensors not declared": sensor_not_declared,
    "runs exchanged": runs_exchanged,
    "same file twice": same_file_twice,
    "few tests": few_runs,
    "tire radius": _one("tire_radius_m", 0.5, 0.8, 2.0, 1000.0),
    "tire stiffness per tire": _all("tire_stiffness_N_per_m", 0.5, 0.25),
    "tire stiffness": _one("tire_stiffness_N_per_m", 0.1, 0.7, 1.4, 10.0),
    "tire damping": _all("tire_damping_N_s_per_m", 0.1, 10.0),
}
