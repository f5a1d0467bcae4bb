"""Faults of numbers in the campaign file: data of the vehicle in other units, exchanged, of one side, forgotten."""

from __future__ import annotations

import re

from studies.check_faults.made import Copy, Fault, Made, change_text, numbers_of
from studies.faults.campaign_copy import CampaignCopy, DoesNotApply

_NUMBER = r"\d+(?:\.\d+)?"


def times(key: str, factor: float, what: str, words: str, harmless: str = "") -> Fault:
    """All numbers of a key are multiplied."""

    def fault(c: Copy) -> Made:
        def line(m: re.Match[str]) -> str:
            return m.group(1) + re.sub(_NUMBER, lambda n: f"{float(n.group(0)) * factor:.6g}", m.group(2))

        change_text(c, rf"(?<!\w)({key} = )(\[[^\]]*\]|[\d.]+)", line)
        return Made(f"{key} {what}", (words,), harmless=harmless)

    return fault


def loads_without_axles(c: CampaignCopy) -> Made:
    """The axle loads lack the unsprung masses."""
    unsprung = [float(v) for v in re.findall(r"(?m)^unsprung_mass_kg = ([\d.]+)", c.text)]

    def line(m: re.Match[str]) -> str:
        loads = [float(v) for v in m.group(1).split(",")]
        return f"axle_loads_kg = [{', '.join(f'{a - b:g}' for a, b in zip(loads, unsprung, strict=True))}]"

    change_text(c, r"^axle_loads_kg = \[([^\]]*)\]", line)
    return Made("axle loads without unsprung masses", (r"axle_loads_kg|axle loads|sprung_mass_kg",))


def sprung_with_axles(c: CampaignCopy) -> Made:
    """The sprung masses hold the unsprung ones too."""
    more = sum(float(v) for v in re.findall(r"(?m)^unsprung_mass_kg = ([\d.]+)", c.text))

    def line(m: re.Match[str]) -> str:
        masses = [float(v) for v in m.group(1).split(",")]
        masses[-1] += more
        return f"sprung_mass_kg = [{', '.join(f'{v:g}' for v in masses)}]"

    change_text(c, r"^sprung_mass_kg = \[([^\]]*)\]", line)
    return Made("sprung masses with the unsprung ones", (r"sprung_mass_kg|axle_loads_kg",))


def loads_of_the_other_case(c: CampaignCopy) -> Made:
    """The axle loads of the first load case are those of the second."""
    loads = numbers_of(c, "axle_loads_kg")
    if len(loads) < 2:
        raise DoesNotApply("one load case")
    second = "axle_loads_kg = [" + ", ".join(f"{v:g}" for v in loads[1]) + "]"
    change_text(c, r"^axle_loads_kg = \[[^\]]*\]", second, count=1)
    return Made("axle loads of the other load case", (r"sprung_mass_kg|axle_loads_kg|axle loads",))


def unsprung_exchanged(c: CampaignCopy) -> Made:
    """The unsprung masses of the first and the second axle are exchanged."""
    found = re.findall(r"(?m)^unsprung_mass_kg = ([\d.]+)", c.text)
    if found[0] == found[1]:
        raise DoesNotApply("alike")
    new = iter([found[1], found[0], *found[2:]])
    change_text(c, r"^unsprung_mass_kg = [\d.]+", lambda _: f"unsprung_mass_kg = {next(new)}")
    return Made("unsprung masses of axles 1 and 2 exchanged", (r"unsprung",))


def hitch_moved(c: CampaignCopy) -> Made:
    """The fifth wheel stands a metre further back than it is."""
    change_text(c, r"^hitch_x_m = ([\d.]+)", lambda m: f"hitch_x_m = {float(m.group(1)) - 1.0:g}")
    return Made("hitch 1 m off", (r"hitch",))


def sensor_of_the_other_body(c: CampaignCopy) -> Made:
    """A frame sensor is listed on the other body."""
    names = re.findall(r'\[\[vehicle\.body\]\][^\n]*\nname = "([^"]+)"', c.text)
    if len(names) < 2:
        raise DoesNotApply("one body")
    column = c.pick(re.findall(rf'(?m)^(\S+) += .*body = "{names[0]}"', c.text))
    change_text(c, rf'^({column} += .*body = )"[^"]+"', rf'\1"{names[1]}"')
    return Made(f"{column} listed on '{names[1]}'", (f"{column}",), frozenset([column]))


def places_in_cm(c: CampaignCopy) -> Made:
    """All places stand in centimetres."""
    change_text(c, r"\b(x_m|hitch_x_m) = ([\d.]+)", lambda m: f"{m.group(1)} = {float(m.group(2)) * 100:g}")
    return Made("all positions in cm", (r"x_m|positions",))


def travel_in_mm(c: CampaignCopy) -> Made:
    """The travels of the suspensions stand in millimetres."""
    change_text(
        c, r"^((?:jounce|rebound)_travel_m) = ([\d.]+)", lambda m: f"{m.group(1)} = {float(m.group(2)) * 1e3:g}"
    )
    return Made("travels in mm", (r"travel",))


def wrong_range(c: CampaignCopy) -> Made:
    """The ranges of all axle accelerometers are a tenth of what they are."""
    change_text(c, r"(axle_acceleration.*range = )([\d.]+)", lambda m: f"{m.group(1)}{float(m.group(2)) / 10:g}")
    columns = re.findall(r"(?m)^(\S+) += .*axle_acceleration", c.text)
    return Made(
        "ranges of the axle sensors a tenth",
        tuple(f"{x}.*(range|unit|file is in)" for x in columns),
        frozenset(columns),
    )


def unknown_key(c: CampaignCopy) -> Made:
    """A key is misspelt."""
    change_text(c, r"^unsprung_mass_kg", "unsprung_mas_kg", count=1)
    return Made("unsprung_mas_kg", (r"unsprung_mas",))


def unknown_name(c: CampaignCopy) -> Made:
    """A run names a load case that is not there."""
    change_text(c, r'load_case = "(\w+)"', 'load_case = "half"', count=1)
    return Made("a load case of an unknown name", (r"half",))


def not_toml(c: CampaignCopy) -> Made:
    """A bracket is missing."""
    change_text(c, r"^(axle_loads_kg = \[[^\]]*)\]", r"\1", count=1)
    return Made("a bracket missing in campaign.toml", (r"campaign\.toml|line",))


FAULTS: dict[str, Fault] = {
    "axle loads without axles": loads_without_axles,
    "sprung masses with axles": sprung_with_axles,
    "axle loads of the other load case": loads_of_the_other_case,
    "sprung masses in t": times("sprung_mass_kg", 1e-3, "in t", r"sprung_mass_kg"),
    "unsprung masses of a side": times("unsprung_mass_kg", 0.5, "of one side", r"unsprung_mass_kg|axle_loads_kg"),
    "unsprung masses exchanged": unsprung_exchanged,
    "centres of gravity in mm": times("cg_height_m", 1e3, "in mm", r"cg_height_m"),
    "radius of the tires in mm": times("tire_radius_m", 1e3, "in mm", r"tire_radius_m"),
    "radius of the tires in inches": times("tire_radius_m", 39.37, "in inches", r"tire_radius_m"),
    "hitch 1 m off": hitch_moved,
    "frame sensor of the other body": sensor_of_the_other_body,
    "positions in cm": places_in_cm,
    "travels in mm": travel_in_mm,
    "ranges of axle sensors": wrong_range,
    "sample interval ten times": times("sample_interval_s", 10.0, "ten times", r"sample_interval_s|stamps|interval"),
    "key misspelt": unknown_key,
    "load case unknown": unknown_name,
    "bracket missing": not_toml,
}
