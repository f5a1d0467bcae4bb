"""What a name says as a whole: words, numbers and units in the names of columns, read with the columns beside it."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

from sysid.campaign.records import KIND_DIMENSION, SensorKind
from sysid.campaign.units import Dimension, is_other_quantity, recognised_unit
from sysid.first_look.vocabulary import LONGEST, Meaning, folded, meanings, vocabulary

Side = Literal["left", "right"]
PlaceWord = Literal["front", "pusher", "drive", "tag", "rear", "trailer"]
#: Order of the places of axles, front to rear.
PLACES: tuple[PlaceWord, ...] = ("front", "pusher", "drive", "tag", "rear", "trailer")

_SPLIT = re.compile(r"[a-z]+|\d+")
_CAMEL = re.compile(r"(?<=[^\W\d_])(?=[^\W\d_])")
_ORDINAL = re.compile(r"(\d+)(?:(?:st|nd|rd|th|er|ere|eme|re|e|o|a)\b|[.°º](?=[\s_-]*[a-z]))")
_BRACKETS = re.compile(r"[\[(<{]\s*([^\[\](){}<>]+?)\s*[\])>}]")
_DIMENSIONS = tuple(dict.fromkeys(KIND_DIMENSION.values()))
#: Units at the end of a name without brackets, where signs are left out or written as underscores.
_PLAIN_UNITS = {
    "ms2": "m/s^2", "mps2": "m/s^2", "mss": "m/s^2", "mms2": "mm/s^2", "inch": "in", "kmh": "km/h", "kph": "km/h",
    "mph": "mph", "mps": "m/s", "degs": "deg/s", "dps": "deg/s", "rads": "rad/s", "mvv": "mv/v", "degc": "degc",
}  # fmt: skip


@dataclass(frozen=True)
class Reading:
    """What the words of a name say: values of each attribute, and words whose meaning nothing decides.

    `said` maps an attribute to the values that words of one meaning give, each with its word; `open_words` are words of
    several meanings.
    """

    words: tuple[str, ...]
    said: Mapping[str, Mapping[str, str]]
    open_words: tuple[str, ...] = ()

    def all(self, attribute: str) -> frozenset[str]:
        """All values of an attribute that are said."""
        return frozenset(self.said.get(attribute, ()))

    def one(self, attribute: str) -> str | None:
        """The value of an attribute, None where none is said or several are."""
        values = self.all(attribute)
        return next(iter(values)) if len(values) == 1 else None

    def has(self, attribute: str, *values: str) -> bool:
        """Whether one of these values is said."""
        return bool(self.all(attribute) & set(values))


class AxleLabel(NamedTuple):
    """How a name calls an axle: `number` from 0 or 1 as names count, `place`, and its end `within` a group of axles."""

    number: int | None = None
    place: PlaceWord | None = None
    within: str | None = None


NO_AXLE = AxleLabel()


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


def tokens(text: str) -> list[str]:
    """Words and numbers of a name in their order: ``axle1Accel_g`` is axle, 1, accel, g."""
    text = unicodedata.normalize("NFKC", text)
    split = _CAMEL.sub(lambda m: " " if text[m.start() - 1].islower() and text[m.start()].isupper() else "", text)
    return _SPLIT.findall(folded(split))


def _meant(words: Sequence[str]) -> Iterator[tuple[int, int, tuple[Meaning, ...]]]:
    """Meanings of the words and phrases of a name: first word, number of words, meanings."""
    known = vocabulary().meanings
    i = 0
    while i < len(words):
        length = next((n for n in range(LONGEST, 1, -1) if tuple(words[i : i + n]) in known and i + n <= len(words)), 1)
        phrase = tuple(words[i : i + length])
        yield i, length, known[phrase] if length > 1 else meanings(words[i]) if words[i].isalpha() else ()
        i += length


class Beside:
    """Names that stand beside each other: by all words but one, the words in place of that one."""

    def __init__(self, names: Iterable[Sequence[str]] = ()) -> None:
        self._others: dict[tuple[tuple[str, ...], int], set[str]] = {}
        for name in {tuple(n) for n in names}:
            for i, word in enumerate(name):
                self._others.setdefault(((*name[:i], *name[i + 1 :]), i), set()).add(word)

    def contrasts(self, words: Sequence[str], i: int) -> list[Meaning]:
        """Meanings of the words that stand in place of word `i` in names that are the same otherwise."""
        others = self._others.get(((*words[:i], *words[i + 1 :]), i), set()) - {words[i]}
        return [m for other in sorted(others) if other.isalpha() for m in meanings(other)]


_ALONE = Beside()


def read_words(words: Sequence[str], beside: Beside = _ALONE) -> Reading:
    """What words say together.

    A word of several meanings takes those that the others do not contradict; among these the one in which a name
    `beside` it, that differs in this word only, has another value: ``FR`` beside ``FL`` is front right.
    """
    items = list(_meant(words))
    said: dict[str, dict[str, str]] = {}
    for i, length, found in items:
        if len(found) == 1 and "weak" not in found[0]:
            _add(said, found[0], words[i : i + length])
    fixed = {key: frozenset(values) for key, values in said.items()}
    left: list[str] = []
    for i, length, found in items:
        if len(found) < 2 and not any("weak" in m for m in found):
            continue
        chosen = _chosen(found, fixed, beside.contrasts(words, i) if length == 1 else ())
        if chosen is not None:
            _add(said, chosen, words[i : i + length])
        elif len(words[i]) > 1 or length > 1:
            left.append(" ".join(words[i : i + length]))
    return Reading(tuple(words), said, tuple(left))


def _add(said: dict[str, dict[str, str]], meaning: Meaning, words: Sequence[str]) -> None:
    for key, value in _bare(meaning).items():
        said.setdefault(key, {}).setdefault(value, " ".join(words))


def _bare(meaning: Meaning) -> dict[str, str]:
    return {key: value for key, value in meaning.items() if key != "weak"}


def _chosen(found: Sequence[Meaning], fixed: Mapping[str, frozenset[str]], beside: Sequence[Meaning]) -> Meaning | None:
    """The one of several meanings that the name and the names beside it leave, None where they leave more."""
    contrasted = [m for m in found if any(_bare(m).keys() == _bare(o).keys() and _bare(m) != _bare(o) for o in beside)]
    if len(contrasted) == 1:
        return contrasted[0]
    fitting = [m for m in contrasted or found if not _against(m, fixed)]
    # Nobody says a thing twice: a meaning that adds something is meant.
    adding = [m for m in fitting if any(key not in fixed for key in _bare(m))]
    if len(adding) == 1 and (len(fitting) == 1 or len(adding) < len(fitting)):
        alone = len(found) == 1
        return None if alone and "weak" in adding[0] else adding[0]
    return None


def _against(meaning: Meaning, fixed: Mapping[str, frozenset[str]]) -> bool:
    """Whether a meaning contradicts what is said."""
    return any(key in fixed and value not in fixed[key] for key, value in _bare(meaning).items())


# ---------------------------------------------------------------------- columns

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


# ---------------------------------------------------------------------- axles


def place_of(reading: Reading) -> tuple[PlaceWord | None, str | None]:
    """Place of an axle and its end within a group; None where none is said, or places contradict each other."""
    place, end = reading.one("place"), reading.one("end")
    if len(reading.all("place")) > 1:
        return None, None
    for known in PLACES:
        if known in (place, end if place is None else None):
            return known, end if place is not None and end != place else None
    return None, None


def side_of(reading: Reading) -> Side | None:
    """Side of the vehicle, None where none or both are said."""
    side = reading.one("side")
    return "left" if side == "left" else "right" if side == "right" else None


def place_word(words: Sequence[str], beside: Beside = _ALONE) -> PlaceWord | None:
    """The word for a place of an axle, None where there is none or more than one kind of it."""
    return place_of(read_words(words, beside))[0]


def axle_number(name: str) -> tuple[int | None, bool]:
    """The only number that may be an axle's, and whether a word for axle stands at it."""
    words = tokens(name)
    counted = [(i, int(w)) for i, w in enumerate(words) if w.isdigit() and len(w) <= 2]
    behind = {number for i, number in counted if i and _is_axle(words[i - 1])}
    if behind:
        return (behind.pop(), True) if len(behind) == 1 else (None, False)
    ordinal = {int(m[1]) for m in _ORDINAL.finditer(folded(name)) if len(m[1]) <= 2}
    ordinal |= {vocabulary().ordinal[w] for w in words if len(w) > 1 and w in vocabulary().ordinal}
    if len(ordinal) == 1 and any(map(_is_axle, words)):
        return ordinal.pop(), True
    numeral = [vocabulary().ordinal[b] for a, b in pairwise(words) if _is_numeral(b) and _is_axle(a)]
    if len(numeral) == 1:
        return numeral[0], True
    channel = vocabulary().channel
    free = [n for i, n in counted if not (i and words[i - 1] in channel) and not (i == 0 and len(words) == 1)]
    return (free[0] if len(free) == 1 else None), False


def _is_numeral(word: str) -> bool:
    return word in vocabulary().ordinal and not word.strip("iv")


def _is_axle(word: str) -> bool:
    found = meanings(word) if word.isalpha() else ()
    return any(m.get("mount") == "axle" for m in found)
