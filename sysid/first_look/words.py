"""What the words and numbers of a name say together, read with the names beside it."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

from sysid.first_look.vocabulary import LONGEST, Meaning, folded, meanings, phrase, vocabulary, without_elided

Side = Literal["left", "right"]
PlaceWord = Literal["front", "pusher", "drive", "tag", "middle", "rear", "trailer"]
#: Order of the places of axles, front to rear.
PLACES: tuple[PlaceWord, ...] = ("front", "pusher", "drive", "tag", "middle", "rear", "trailer")

_SPLIT = re.compile(r"[a-z]+|\d+")
_CAMEL = re.compile(r"(?<=[^\W\d_])(?=[^\W\d_])")
_JOINED = re.compile(r"(?<![\d.,-])(\d)\.?\s?([/+&-])\s?(\d)(?![\d,-]|\.\d)")
_ORDINAL = re.compile(r"(\d+)(?:(?:st|nd|rd|th|er|ere|eme|re|e|o|a)\b|[.°º](?=[\s_-]*[a-z]))")


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


def tokens(text: str) -> list[str]:
    """Words and numbers of a name in their order: ``axle1Accel_g`` is axle, 1, accel, g."""
    text = unicodedata.normalize("NFKC", text)
    split = _CAMEL.sub(lambda m: " " if text[m.start() - 1].islower() and text[m.start()].isupper() else "", text)
    return _SPLIT.findall(without_elided(folded(split)))


def _meant(words: Sequence[str]) -> Iterator[tuple[int, int, tuple[Meaning, ...]]]:
    """Meanings of the words and phrases of a name: first word, number of words, meanings."""
    i = 0
    while i < len(words):
        longest = min(LONGEST, len(words) - i)
        length = next((n for n in range(longest, 1, -1) if phrase(tuple(words[i : i + n]))), 1)
        found = phrase(tuple(words[i : i + length])) if length > 1 else meanings(words[i]) if words[i].isalpha() else ()
        yield i, length, found
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
            continue
        if len(found) > 1:
            # What all meanings have in common is said.
            shared = set.intersection(*(set(_bare(m).items()) for m in found))
            _add(said, dict(shared), words[i : i + length])
        if len(words[i]) > 1 or length > 1:
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


def denied(words: Sequence[str], attribute: str) -> bool:
    """Whether a word such as "not" stands before one that says `attribute`, and no phrase of both is known."""
    meant = list(_meant(words))
    says = [any(attribute in m for m in found) for _, _, found in meant]
    return any(
        length == 1 and words[i] in vocabulary().denial and any(says[k + 1 : k + 3])
        for k, (i, length, _) in enumerate(meant)
    )


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
    if _says_two_axles(name, len(counted)):
        return None, False
    plain = folded(name)
    ordinals = [(int(m[1]), tokens(plain[m.end() :])[:1]) for m in _ORDINAL.finditer(plain) if len(m[1]) <= 2]
    # "2nd axle 1" is the first repeat.
    before = {number for number, word in ordinals if word and _is_axle(word[0])}
    if len(before) == 1:
        return before.pop(), True
    behind = {number for i, number in counted if i and _is_axle(words[i - 1])}
    if behind:
        return (behind.pop(), True) if len(behind) == 1 else (None, False)
    ordinal = {number for number, _ in ordinals}
    ordinal |= {vocabulary().ordinal[w] for w in words if len(w) > 1 and w in vocabulary().ordinal}
    if len(ordinal) == 1 and any(map(_is_axle, words)):
        return ordinal.pop(), True
    numeral = [vocabulary().ordinal[b] for a, b in pairwise(words) if _is_numeral(b) and _is_axle(a)]
    if len(numeral) == 1:
        return numeral[0], True
    channel = vocabulary().channel
    free = [n for i, n in counted if not (i and words[i - 1] in channel) and not (i == 0 and len(words) == 1)]
    return (free[0] if len(free) == 1 else None), False


def _says_two_axles(name: str, numbers: int) -> bool:
    """Whether a number and the next one are joined: ``2./3.``, ``2+3``; by a dash only beside a third number."""
    found = [(m[2], int(m[3]) - int(m[1])) for m in _JOINED.finditer(name)]
    return any(one_above == 1 and (mark != "-" or numbers > 2) for mark, one_above in found)


def _is_numeral(word: str) -> bool:
    return word in vocabulary().ordinal and not word.strip("iv")


def _is_axle(word: str) -> bool:
    found = meanings(word) if word.isalpha() else ()
    return any(m.get("mount") == "axle" for m in found)
