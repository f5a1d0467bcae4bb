"""What the path of a log says: plank drop or bump run, axle, speed, load case."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Literal

from sysid.first_look.words import PlaceWord, axle_number, folded, place_word, tokens

TestKind = Literal["plank_drop", "bump_run"]

_NUMBER = r"(\d{1,3}(?:[.,p]\d{1,2})?)"
#: Speeds as people write them into names, with the factor to km/h.
_SPEEDS = (
    (re.compile(_NUMBER + r"[\s_-]*(?:km[\s_/-]?h|kmph|kph)(?![a-z])"), 1.0),
    (re.compile(_NUMBER + r"[\s_-]*mph(?![a-z])"), 1.609344),
    (re.compile(_NUMBER + r"[\s_-]*(?:mps|m[\s_-]?s)(?![a-z0-9])"), 3.6),
    (re.compile(r"(?<![a-z])v[\s_=-]?" + _NUMBER + r"(?![\d.,])"), 1.0),
)
_DROP_STEMS = ("drop", "plank", "fall", "abwurf", "chute", "planche", "bohle", "absenk", "ausschwing")
_RUN_STEMS = ("bump", "hump", "fahrt", "schwelle", "ralenti", "passage", "ueberfahrt", "dosdane", "speedtable")
_RUN_WORDS = frozenset(("run", "runs", "cushion", "dos"))
_EMPTY = (("unloaded", "unladen", "empty", "leer", "unbeladen"), frozenset(("vide", "ul", "tare", "curb")))
_LADEN = (("loaded", "laden", "beladen", "voll", "charg", "plein"), frozenset(("full", "gvw", "load")))
_PARTLY = (("half", "halb", "teil", "partly", "partial", "demi", "mid"), frozenset(("part",)))
#: Numbers that count repeats.
_REPEAT = re.compile(
    r"(?:run|rep|repeat|drop|test|wdh|messung|essai|nr|no|lauf|fahrt|versuch|chute|take|case|r)[\s_-]*\d{1,3}(?!\d)"
)


@dataclass(frozen=True)
class PathSays:
    """What the path of a log says; None where it says nothing.  `load_case` is ``empty``, ``laden`` or ``partly``,
    `load_word` the word that said so."""

    kind: TestKind | None = None
    speed_km_h: float | None = None
    load_case: str | None = None
    load_word: str = ""
    axle: int | None = None
    place: PlaceWord | None = None


def path_says(path: str) -> PathSays:
    """What the relative path of a log says: the name of the file counts before those of its folders."""
    parts = list(PurePosixPath(path).parts)
    parts[-1] = PurePosixPath(path).stem
    parts = [folded(p) for p in reversed(parts)]
    speed = next((s for s in map(_speed, parts) if s is not None), None)
    kind = next((k for k in map(_kind, parts) if k is not None), None)
    load, word = next((load for load in map(_load, parts) if load[0] is not None), (None, ""))
    axles = [_axle(p) for p in parts]
    axle = next((a for a in axles if a[0] is not None or a[1] is not None), (None, None))
    if kind is None and speed is not None:
        kind = "bump_run"
    return PathSays(kind, speed, load, word, *axle)


def _speed(part: str) -> float | None:
    for pattern, factor in _SPEEDS:
        match = pattern.search(part)
        if match:
            value = float(re.sub("[,p]", ".", match[1])) * factor
            return round(value, 1) if 0.5 <= value <= 150.0 else None
    return None


def _kind(part: str) -> TestKind | None:
    words = [w for w in tokens(part) if not w.isdigit()]
    drop = any(s in w for w in words for s in _DROP_STEMS)
    run = any(w in _RUN_WORDS or any(s in w for s in _RUN_STEMS) for w in words)
    return None if drop == run else "plank_drop" if drop else "bump_run"


def _load(part: str) -> tuple[str | None, str]:
    words = [w for w in tokens(part) if not w.isdigit()]
    for name, (stems, alone) in (("partly", _PARTLY), ("empty", _EMPTY), ("laden", _LADEN)):
        for word in words:
            if word in alone or any(word.startswith(s) for s in stems):
                return name, word
    return None, ""


def _axle(part: str) -> tuple[int | None, PlaceWord | None]:
    bare = _REPEAT.sub(" ", part)
    for pattern, _ in _SPEEDS:
        bare = pattern.sub(" ", bare)
    words = tokens(bare)
    place = place_word([w for w in words if not w.isdigit()])
    named = any(w in ("axle", "achse", "essieu", "ax", "axl", "ach", "a", "pont") or "achs" in w for w in words)
    # "rear 2" is a repeat as likely as an axle.
    return (axle_number(words) if named or place in ("drive", "tag", "trailer") else None), place
