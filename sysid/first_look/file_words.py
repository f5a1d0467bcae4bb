"""What the path of a log says: plank drop or bump run, axle, speed, load case."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Literal

from sysid.first_look.vocabulary import folded, meanings, vocabulary
from sysid.first_look.words import (
    NO_AXLE,
    AxleLabel,
    Beside,
    Reading,
    Side,
    axle_number,
    denied,
    place_of,
    read_words,
    side_of,
    tokens,
)

TestKind = Literal["plank_drop", "bump_run", "road_drive"]

_NUMBER = r"(\d{1,3}(?:[.,p]\d{1,2})?)"
#: Speeds as people write them into names, with the factor to km/h; None: the name does not say the unit.
_SPEEDS = (
    (re.compile(_NUMBER + r"[\s_-]*(?:km[\s_/-]?h|kmph|kph)(?![a-z])"), 1.0),
    (re.compile(_NUMBER + r"[\s_-]*(?:mph|mi[\s_/-]?h)(?![a-z])"), 1.609344),
    (re.compile(_NUMBER + r"[\s_-]*(?:mps|m[\s_/-]?s)(?![a-z0-9])"), 3.6),
    (re.compile(r"(?<![a-z])v[\s_=-]?" + _NUMBER + r"(?![\d.,])"), None),
)
#: Load cases by weight or number: they have a name, and nothing says how much of the load it is.
_WEIGHT = re.compile(
    r"(?<![a-z0-9.,])(\d{1,2}(?:[.,]\d{1,2})?)[\s_-]?(?:t|to|tons?|tonnen|tonnes?|toneladas)(?![a-z0-9])"
)
_KILOGRAMS = re.compile(r"(?<![a-z0-9.,])(\d{4,5})[\s_-]?kg(?![a-z0-9])")
_CASE = re.compile(
    r"(?<![a-z])(?:lc|lf|load[\s_-]?case|lastfall|beladungsfall|cas[\s_-]de[\s_-]charge|caso[\s_-]de[\s_-]carga)"
    r"[\s_-]?(\d{1,2}|[a-f])(?![a-z0-9])"
)
#: Share of the load: words in front of or behind a percentage.
_SHARE = re.compile(r"(?<![\d.,])(\d{1,3})[\s_-]?(?:%|pct|percent|prozent|proz)(?![a-z])")
_GLUED = re.compile(r"([a-z]+)(\d{1,2})(?!\d)")
#: A word and the number behind it, which is no ordinal such as 2nd.
_COUNTED = re.compile(r"([a-z]+)[\s_.#-]*\d{1,4}(?!\d|(?:st|nd|rd|th|er|ere|eme|re|e|o|a)(?![a-z])|°)")


@dataclass(frozen=True)
class LoadSaid:
    """The load case that a path says: what the truck carries (``empty``, ``half``, ``partly``, ``laden``,
    ``overload``; None: not said), the word for it, and whether the word has that one meaning."""

    kind: str | None
    word: str
    sure: bool = True


@dataclass(frozen=True)
class PathSays:
    """What the path of a log says; None where it says nothing.

    - `kind` of test; `no_test`: a word for what is neither drop nor run, such as a calibration;
    - `speed_km_h`, and whether the name says its unit;
    - `axle` and `side` as in the names of columns;
    - `load`: the load case; `contradicts`: words of the path that contradict each other.
    """

    kind: TestKind | None = None
    speed_km_h: float | None = None
    speed_unit_said: bool = True
    load: LoadSaid | None = None
    axle: AxleLabel = NO_AXLE
    side: Side | None = None
    no_test: str | None = None
    contradicts: tuple[str, ...] = ()


def path_says(path: str) -> PathSays:
    """What a relative path says by itself."""
    return paths_say([path])[path]


def paths_say(paths: Sequence[str]) -> dict[str, PathSays]:
    """What the relative paths of logs say, each read with the others beside it.

    The name of a file counts before those of its folders, but a word of one meaning before one of several.
    """
    split = {path: _parts(path) for path in paths}
    depth = max((len(parts) for parts in split.values()), default=0)
    beside = [Beside(tokens(parts[k]) for parts in split.values() if k < len(parts)) for k in range(depth)]
    whole = Beside(map(tokens, paths))
    return {path: _says(path, parts, beside, whole) for path, parts in split.items()}


def _parts(path: str) -> list[str]:
    """Names from the file up to the first folder."""
    pure = PurePosixPath(path)
    return [pure.stem, *reversed(pure.parts[:-1])]


def _says(path: str, parts: Sequence[str], beside: Sequence[Beside], whole: Beside) -> PathSays:
    readings = [read_words(tokens(part), names) for part, names in zip(parts, beside, strict=False)]
    plain = [folded(part) for part in parts]
    speed, factor = next((s for s in map(_speed, plain) if s is not None), (None, 1.0))
    kinds = [_kind(r) for r in readings]
    kind = next((k for k in kinds if k is not None), None)
    kind = next((k for k in kinds if k is not None and "step" not in k), kind)
    if kind is None and speed is not None:
        kind = "run"
    loads = [load for r, p in zip(readings, plain, strict=True) if (load := _load(r, p)) is not None]
    sure = [load for load in loads if load.sure]
    contradicts = [
        f"'{load.word}'" for load in sure[:1] + [x for x in sure[1:] if x.kind != sure[0].kind] if len(sure) > 1
    ]
    axles = [_axle(part, r) for part, r in zip(parts, readings, strict=True)]
    axle, side = next((a for a in axles if a[0] != NO_AXLE), (NO_AXLE, None))
    none = next((r for r in readings if r.has("test", "none")), None)
    return PathSays(
        None if kind is None else "plank_drop" if kind in ("drop", "step") else "bump_run",
        speed if speed is None or factor is None else round(speed * factor, 1),
        factor is not None,
        next(iter(sure or loads), None) or _load_beside(path, whole),
        axle,
        side,
        none.said["test"]["none"] if none is not None and kind is None else None,
        tuple(contradicts) if len(contradicts) > 1 else (),
    )


def _speed(part: str) -> tuple[float, float | None] | None:
    for pattern, factor in _SPEEDS:
        match = pattern.search(part)
        if match:
            value = float(re.sub("[,p]", ".", match[1]))
            return (value, factor) if 0.5 <= value * (factor or 1.0) <= 150.0 else None
    return None


def _kind(reading: Reading) -> str | None:
    """``drop``, ``run`` or ``step``, None where the words say none or contradict each other."""
    kinds = reading.all("test") - {"none"}
    if len(kinds) > 1:
        # A word in front of a number only counts: "drop_run3" is the third drop.
        words = [w for i, w in enumerate(reading.words) if not "".join(reading.words[i + 1 : i + 2]).isdigit()]
        kinds = read_words(words).all("test") - {"none"} or kinds
    return next(iter(kinds)) if len(kinds) == 1 else None


def _load(reading: Reading, part: str) -> LoadSaid | None:
    if denied(tokens(part), "load"):
        return None
    said = reading.all("load")
    share = _SHARE.search(part)
    if share:
        kind = {0: "empty", 100: "laden"}.get(int(share[1]), "partly")
        return LoadSaid(kind, f"{int(share[1])}%", bool(said))
    if "half" in said or "partly" in said:
        said -= {"laden", "some"}
    elif len(said) > 1:
        said -= {"some"}
    if len(said) == 1:
        kind = next(iter(said))
        word = reading.said["load"][kind]
        return LoadSaid("laden" if kind == "some" else kind, word, kind != "some")
    if said:
        return None
    for word in reading.open_words:
        # Such as "charge", which is a load or, without its accent, laden.
        if {m.get("load") for m in meanings(word)} == {"laden", "some"}:
            return LoadSaid("laden", word, False)
    for pattern, name in ((_WEIGHT, "{} t"), (_KILOGRAMS, "{} kg"), (_CASE, "load case {}")):
        match = pattern.search(part)
        if match:
            return LoadSaid(None, name.format(match[1].replace(",", ".")))
    return None


def _load_beside(path: str, whole: Beside) -> LoadSaid | None:
    """A word that nobody knows, in place of the load of another path: ``heavy/run1`` beside ``tare/run1``."""
    words = tokens(path)
    for i, word in enumerate(words):
        if word.isalpha() and not meanings(word) and any("load" in m for m in whole.contrasts(words, i)):
            return LoadSaid(None, word)
    return None


def _axle(part: str, reading: Reading) -> tuple[AxleLabel, Side | None]:
    plain = folded(part)
    for pattern in (*(p for p, _ in _SPEEDS), _WEIGHT, _KILOGRAMS, _CASE, _SHARE):
        plain = pattern.sub(" ", plain)
    place, within = place_of(reading)
    without_repeats = _COUNTED.sub(lambda m: " " if _counts_repeats(m[1]) else m[0], plain)
    number, at_word = axle_number(without_repeats)
    # "rear axle 2" is a repeat as likely as an axle, "HA2" is none, nor is it where another number counts repeats.
    glued = any(m[2] == str(number) and _names_axle(m[1]) for m in _GLUED.finditer(plain))
    keep = glued or (at_word and place is None) or (place is not None and plain != without_repeats)
    # Nor which axle it is, where its word is any axle to one and one of a group to another.
    keep = keep and not any(_names_axle(word) for word in reading.open_words)
    return AxleLabel(number if keep else None, place, within), side_of(reading)


def _names_axle(word: str) -> bool:
    return any("mount" in m or "place" in m or "end" in m for m in meanings(word))


def _counts_repeats(word: str) -> bool:
    """Whether the number behind a word counts repeats, as in ``Leerfahrt2``."""
    repeat = vocabulary().repeat
    if any("place" in m or "mount" in m for m in meanings(word)):
        return word in repeat
    return any(word.endswith(r) and (len(r) > 3 or word == r) for r in repeat)
