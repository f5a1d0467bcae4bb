"""What the names of the columns of a log say: kind, unit, axle and side, or why a column is no sensor of a campaign."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field

from sysid.campaign.records import KIND_DIMENSION, SensorKind
from sysid.campaign.units import Dimension, is_other_quantity, recognised_unit
from sysid.first_look.words import (
    NO_AXLE,
    PLACES,
    AxleLabel,
    Beside,
    Reading,
    Side,
    axle_number,
    place_of,
    read_words,
    side_of,
    tokens,
)

_BRACKETS = re.compile(r"[\[(<{]\s*([^\[\](){}<>]+?)\s*[\])>}]")
_DIMENSIONS = tuple(dict.fromkeys(KIND_DIMENSION.values()))
#: Units at the end of a name without brackets, where signs are left out or written as underscores.
_PLAIN_UNITS = {
    "ms2": "m/s^2", "mps2": "m/s^2", "mss": "m/s^2", "mms2": "mm/s^2", "inch": "in", "kmh": "km/h", "kph": "km/h",
    "mph": "mph", "mps": "m/s", "degs": "deg/s", "dps": "deg/s", "rads": "rad/s", "mvv": "mv/v", "degc": "degc",
}  # fmt: skip


@dataclass(frozen=True)
class NameSays:
    """What the name of a column says; None where it says nothing.

    - `kind`: of a sensor of a campaign; `unused`: why a column is none, such as "a temperature";
    - `unit`, as a campaign file or the name writes it;
    - `axle`: its number, place and end in a group of axles; `numbered`: whether a word for axle stands at the number;
    - `doubts`: words that have several meanings.
    """

    kind: SensorKind | None = None
    unit: str | None = None
    axle: AxleLabel = NO_AXLE
    numbered: bool = False
    side: Side | None = None
    unused: str | None = None
    doubts: tuple[str, ...] = field(default=())


#: Reasons why a column is no sensor of a campaign, by quantity.
_UNUSED = {
    "temperature": "a temperature",
    "strain": "a strain",
    "force": "a force or moment",
    "angle": "an angle",
    "location": "a position on earth or a distance driven",
    "battery": "a voltage or current",
    "counter": "a counter",
    "trigger": "a mark or state",
    "engine": "of the engine",
    "sound": "a sound",
    "time": "a time",
}
_OTHER_PRESSURES = {"brake": "a brake pressure", "tire": "a tire pressure", "other": "a pressure of no air spring"}
#: What columns of no use may be measured in, where it is not a unit that no sensor has.
UNUSED_DIMENSIONS = {
    _UNUSED["location"]: "length",
    "an acceleration along or across the vehicle": "acceleration",
    "an acceleration of neither frame nor axle": "acceleration",
    "an angular rate of roll or yaw": "angular rate",
    **dict.fromkeys(_OTHER_PRESSURES.values(), "pressure"),
}
#: Quantities whose words stand beside others without meaning a quantity of their own.
_WEAK = frozenset(("counter", "time", "location", "trigger", "battery"))


def columns_say(names: Sequence[str]) -> dict[str, NameSays]:
    """What the names of the columns of a log say, each read with the others beside it."""
    whole = Beside(map(tokens, names))
    of_names = {name: _without_unit(name, whole) for name in names}
    beside = Beside(tokens(rest) for rest, _ in of_names.values())
    return {name: _says(rest, unit, beside) for name, (rest, unit) in of_names.items()}


def column_says(name: str) -> NameSays:
    """What the name of a column says by itself."""
    return columns_say([name])[name]


def _says(rest: str, unit: str | None, beside: Beside) -> NameSays:
    words = tokens(rest)
    reading = read_words(words, beside)
    kind, unused = _kind(reading, unit)
    place, within = place_of(reading)
    number, numbered = axle_number(rest)
    label = AxleLabel(number, place, within)
    return NameSays(kind, unit, label, numbered, side_of(reading), unused, reading.open_words)


def dimension_of(unit: str) -> str | None:
    """What a unit measures: a dimension of a campaign file, ``other``, or None where it is no known unit."""
    known = sensor_unit(unit)
    return known[1] if known is not None else "other" if is_other_quantity(unit) else None


def sensor_unit(written: str) -> tuple[str, Dimension] | None:
    """How a campaign file calls a unit of a sensor that a file writes, and what it measures; None for others."""
    return recognised_unit(written, _DIMENSIONS)


def _without_unit(name: str, beside: Beside) -> tuple[str, str | None]:
    """A name without its unit, and the unit; a last letter with a counterpart ``beside`` it is none: gauche, droite."""
    text = unicodedata.normalize("NFKC", name).strip()
    for match in reversed(list(_BRACKETS.finditer(text))):
        if (unit := _unit(match[1])) is not None:
            return f"{text[: match.start()]} {text[match.end() :]}", unit
    words = tokens(text)
    if words and any({"side", "end"} & m.keys() for m in beside.contrasts(words, len(words) - 1)):
        return text, None
    # The last parts of the name, as in axle_acc_m_s2; a name is no unit.
    pieces = [m.start() for m in re.finditer(r"[\s_,;:|/.-]+", text)]
    for start in pieces[-3:]:
        unit = _unit(re.sub(r"^[\s_,;:|/.-]+", "", text[start:]))
        # Without brackets "Rad" is a wheel and "V" a front.
        known = unit is not None and (sensor_unit(unit) is not None or len(unit) > 3)
        if known and text[:start].strip(" _-"):
            return text[:start], unit
    glued = re.search(r"(?<=\d)(mm|g|mg|cm|bar)$", text)
    return (text[: glued.start()], glued[1]) if glued else (text, None)


def _unit(text: str) -> str | None:
    """A unit as a campaign file writes it, or as it stands where it is one of another quantity."""
    plain = re.sub(r"[\s_*·^.-]", "", text.casefold())
    for spelling in (text, plain, _PLAIN_UNITS.get(plain.replace("/", ""), "")):
        known = sensor_unit(spelling) if spelling else None
        if known is not None:
            return known[0]
        if spelling and is_other_quantity(spelling):
            return spelling
    return None


def _kind(reading: Reading, unit: str | None) -> tuple[SensorKind | None, str | None]:
    """Kind of sensor that a name says, or why its column is none."""
    said = reading.all("quantity")
    dimension = None if unit is None else dimension_of(unit)
    strong = said - _WEAK or said
    if dimension == "acceleration" or (not strong and dimension is None and reading.has("axis", "z")):
        strong = strong - {"deflection"} | {"acceleration"} if strong <= {"acceleration", "deflection"} else strong
    if "acceleration" in strong:
        return _acceleration(reading) if strong <= {"acceleration", "deflection"} else (None, None)
    if "pressure" in strong and strong <= {"pressure", "deflection"}:
        others = [text for what, text in _OTHER_PRESSURES.items() if reading.has("medium", what)]
        if others:
            return None, others[0]
        return ("air_pressure" if reading.has("medium", "spring") or "deflection" in strong else None), None
    if strong == {"speed"}:
        return "speed", None
    if strong == {"rate"} or (reading.has("axis", "pitch") and dimension == "angular rate"):
        if reading.has("axis", "roll", "yaw"):
            return None, "an angular rate of roll or yaw"
        return ("pitch_rate" if reading.has("axis", "pitch") else None), None
    if strong == {"deflection"} and not reading.has("axis", "x", "y"):
        return "suspension_deflection", None
    if (
        not strong
        and dimension == "length"
        and reading.has("mount", "frame")
        and reading.has("mount", "axle", "unsprung")
    ):
        return "suspension_deflection", None
    if len(strong) == 1 and (text := _UNUSED.get(next(iter(strong)))):
        return None, text
    if strong and strong <= _UNUSED.keys():
        return None, "no vertical motion and no pressure"
    return None, None


def _acceleration(reading: Reading) -> tuple[SensorKind | None, str | None]:
    if reading.has("axis", "x", "y") and not reading.has("axis", "z"):
        return None, "an acceleration along or across the vehicle"
    if reading.has("mount", "elsewhere"):
        return None, "an acceleration of neither frame nor axle"
    if reading.has("mount", "frame") and reading.has("mount", "unsprung"):
        return None, None
    if reading.has("mount", "frame"):
        return "body_acceleration", None
    if reading.has("mount", "axle", "unsprung") or reading.has("place", *PLACES):
        return "axle_acceleration", None
    return None, None
