"""What a name says: words of English, German and French, numbers, units and sides in names of columns and files."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from typing import Literal

from sysid.campaign.records import SensorKind

Side = Literal["left", "right"]
PlaceWord = Literal["front", "drive", "tag", "trailer", "rear"]
#: Order of the places of axles, front to rear.
PLACES: tuple[PlaceWord, ...] = ("front", "drive", "tag", "trailer", "rear")

_SPLIT = re.compile(r"[a-zµ°²]+|\d+")
_CAMEL = re.compile(r"(?<=[a-zäöüéèà])(?=[A-Z])")
#: Numbers behind these count channels of the logger, not axles.
_CHANNEL_WORDS = frozenset(
    ("ch", "chan", "channel", "kanal", "kan", "voie", "can", "ai", "in", "input", "col", "column", "spalte", "signal",
     "sig", "kn", "module", "mod", "slot", "dev", "sensor", "capteur", "nr", "no", "sn", "id")
)  # fmt: skip
_AXLE_WORDS = frozenset(("axle", "axles", "achse", "achs", "essieu", "pont", "ax", "axl", "ach", "a"))

# Stems are looked for inside of words, so that German compounds are found; words must stand alone.
_DEFLECTION = (
    ("lvdt", "deflec", "federweg", "einfeder", "displ", "deplac", "debattement", "abstand", "potentio", "seilzug",
     "stroke", "extension", "ausfeder", "rideheight", "wegaufn", "dehnweg"),
    frozenset(("weg", "susp", "travel", "disp", "course", "defl", "pot", "wire", "hoehe", "height", "dist",
               "federung", "suspension", "jounce")),
)  # fmt: skip
_ACCELERATION = (("accel", "beschl"), frozenset(("acc", "acz", "accz", "az", "beschl", "b", "acce")))
_BODY = (
    ("frame", "rahmen", "chass", "aufbau", "caisse", "kabine", "cabin", "fahrgestell", "longeron", "plattform",
     "platform", "ladeflach", "ladeflaech"),
    frozenset(("body", "cab", "deck", "sprung", "cadre", "fr", "bed", "load")),
)  # fmt: skip
_AXLE = (
    ("axle", "achs", "essieu", "unsprung", "ungefedert", "wheel", "knuckle"),
    frozenset(("ax", "axl", "hubs", "rad", "roue", "pont", "radtraeger", "moyeu")),
)
_OTHER = (
    ("speed", "geschw", "vitesse", "veloc", "temp", "press", "druck", "gyro", "winkel", "angle", "lenkrad", "brake",
     "brems", "frein", "trigger", "kraft", "force", "strain", "dehnung", "latitude", "longitude", "satell", "batter",
     "spannung", "volt", "torque", "moment", "drehzahl", "throttle", "counter", "status"),
    frozenset(("gps", "lat", "lon", "alt", "rpm", "yaw", "roll", "nick", "dms", "index", "lightbarrier", "marker",
               "event", "flag", "x", "y", "lateral", "longitudinal", "quer", "laengs", "ay", "kmh", "odo")),
)  # fmt: skip
_PLACES: dict[PlaceWord, tuple[tuple[str, ...], frozenset[str]]] = {
    "front": (("front", "vorder", "vorn", "avant", "steer", "lenkachs", "direct"), frozenset(("va", "fa", "fr", "av"))),
    "drive": (("drive", "antrieb", "moteur", "motrice"), frozenset(("drv", "tandem", "aa", "mot"))),
    "tag": (("nachlauf", "porteur", "pusher", "liftachs"), frozenset(("tag", "lift", "nla"))),
    "trailer": (("trailer", "auflieg", "anhaeng", "remorque"), frozenset(("trl", "semi", "sattel", "tr", "anh"))),
    "rear": (("rear", "hinter", "hinten", "arrier"), frozenset(("ha", "ra", "ar", "back"))),
}
_LEFT, _RIGHT = frozenset(("left", "links", "li", "gauche", "lh")), frozenset(("right", "rechts", "re", "droite", "rh"))

#: Unit by the end of a name; the bare g counts only at the end.
_UNIT_TOKENS: dict[tuple[str, ...], str] = {
    ("m", "s", "2"): "m/s^2",
    ("m", "s2"): "m/s^2",
    ("m", "s²"): "m/s^2",
    ("ms", "2"): "m/s^2",
    ("ms²",): "m/s^2",
    ("mps", "2"): "m/s^2",
    ("mm", "s", "2"): "mm/s^2",
    ("mg",): "mg",
    ("g",): "g",
    ("mm",): "mm",
    ("cm",): "cm",
    ("m",): "m",
    ("in",): "in",
    ("inch",): "in",
    ("um",): "um",
}


@dataclass(frozen=True)
class NameSays:
    """What the name of a column says; None where it says nothing.

    `number` is that of the axle as the name counts, from 0 or 1; `place` its word.  `other` is a column that is no
    sensor of a campaign, such as a speed or a temperature.
    """

    kind: SensorKind | None = None
    unit: str | None = None
    number: int | None = None
    place: PlaceWord | None = None
    side: Side | None = None
    other: bool = False


def folded(text: str) -> str:
    """Small letters without accents; ä, ö, ü and ß as ae, oe, ue and ss."""
    text = text.casefold()
    for letter, two in (("ä", "ae"), ("ö", "oe"), ("ü", "ue"), ("ß", "ss")):
        text = text.replace(letter, two)
    return "".join(c for c in unicodedata.normalize("NFD", text) if not unicodedata.combining(c))


def tokens(text: str) -> list[str]:
    """Words and numbers of a name in their order: ``axle1Accel_g`` is axle, 1, accel, g."""
    return _SPLIT.findall(folded(_CAMEL.sub(" ", unicodedata.normalize("NFC", text))))


def _has(words: list[str], pattern: tuple[tuple[str, ...], frozenset[str]]) -> bool:
    stems, alone = pattern
    return any(w in alone or any(s in w for s in stems) for w in words)


def column_says(name: str) -> NameSays:
    """What the name of a column says."""
    words = tokens(name)
    unit, rest = _unit(words)
    letters = [w for w in rest if not w.isdigit()]
    length = unit in ("mm", "cm", "m", "in", "um")
    acceleration = _has(letters, _ACCELERATION) or unit in ("g", "mg", "m/s^2", "mm/s^2")
    deflection = _has(letters, _DEFLECTION)
    body, axle = _has(letters, _BODY), _has(letters, _AXLE)
    other = _has(letters, _OTHER) and not deflection and not (acceleration and not {"x", "y"} & set(letters))
    kind: SensorKind | None = None
    if other:
        pass
    elif (deflection and not acceleration) or (length and (deflection or (body and axle))):
        kind = "suspension_deflection"
    elif acceleration and body:
        kind = "body_acceleration"
    elif acceleration and axle and not deflection:
        kind = "axle_acceleration"
    return NameSays(kind, unit, axle_number(rest), place_word(letters), _side(letters), other)


def _unit(words: list[str]) -> tuple[str | None, list[str]]:
    """Unit at the end of a name, and the words before it."""
    for length in (3, 2, 1):
        unit = _UNIT_TOKENS.get(tuple(words[-length:])) if len(words) > length else None
        if unit is not None:
            return unit, words[:-length]
    return None, words


def axle_number(words: list[str]) -> int | None:
    """The number that can be an axle's: the one behind a word for axle, else the only one that counts no channels."""
    numbers = [(i, int(w)) for i, w in enumerate(words) if w.isdigit() and len(w) <= 2]
    for i, number in numbers:
        if i and (words[i - 1] in _AXLE_WORDS or any(s in words[i - 1] for s in ("axle", "achs", "essieu"))):
            return number
    free = [n for i, n in numbers if not (i and words[i - 1] in _CHANNEL_WORDS) and not (i == 0 and len(words) == 1)]
    return free[0] if len(free) == 1 else None


def place_word(letters: list[str]) -> PlaceWord | None:
    """The word for a place of an axle, None where there is none or more than one kind of it."""
    # "fr" is short for frame as often as for front, and frames stand above axles.
    places = [p for p, pattern in _PLACES.items() if _has([w for w in letters if w != "fr"], pattern)]
    if len(places) == 2 and places[1] == "rear" and places[0] in ("drive", "trailer", "tag"):
        return places[0]
    if len(places) == 2 and places[0] == "front" and places[1] in ("drive", "trailer", "tag"):
        return places[1]
    return places[0] if len(places) == 1 else None


def _side(letters: list[str]) -> Side | None:
    left, right = bool(_LEFT & set(letters)), bool(_RIGHT & set(letters))
    return None if left == right else "left" if left else "right"


def paired_sides(names: list[str]) -> dict[str, Side]:
    """Sides of columns whose names differ in a lone l and r only."""
    result: dict[str, Side] = {}
    known = {tuple(tokens(n)): n for n in names}
    for words, name in known.items():
        for i, word in enumerate(words):
            other = known.get((*words[:i], "r", *words[i + 1 :])) if word == "l" else None
            if other is not None:
                result |= {name: "left", other: "right"}
    return result
