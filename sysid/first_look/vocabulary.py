"""What single words say: the lists of `vocabulary.toml`, compounds of their words, endings, and words cut off."""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

#: What a word says in one of its meanings: attributes with values, such as ``{"end": "front", "side": "left"}``.
Meaning = Mapping[str, str]

#: Words that have lost their vowel, in small letters: French and Italian `d'essieu`, `l'asse`, `qu'`, `dell'asse`.
_ELIDED = re.compile(r"(?<![a-z])(?:[a-z]|qu|dell|nell|all|sull|un)['’](?=[a-z])")
_UMLAUTS = (("ä", "ae"), ("ö", "oe"), ("ü", "ue"), ("ß", "ss"))
_ENDINGS = ("s", "es", "n", "en", "e", "er", "em", "ed", "ing", "d", "ung", "ungen", "al", "ale", "ly", "x")
_LINKS = ("", "s", "n", "en", "es", "e")
#: Shortest words that are found inside of others: with others that cover all of it, and with a rest that nobody knows.
_IN_COMPOUND, _IN_UNKNOWN, _CUT_OFF = 3, 5, 5
#: Syllables that turn the meaning of the rest round.
_NEGATIONS = ("un", "ent", "de", "des", "dis", "non", "in", "ab", "no")
#: Attributes that only whole words and compounds say: what a part of an unknown word says is too little for them.
_WHOLE = frozenset(("test", "load"))
#: Longest phrase, in words.
LONGEST = 4


@dataclass(frozen=True)
class Vocabulary:
    """Meanings of words and of phrases, phrases `joined` to one word, words in front of numbers of channels and of
    repeats, words that deny the next one, parts of compounds that say nothing, and ordinal numbers."""

    meanings: Mapping[tuple[str, ...], tuple[Meaning, ...]]
    joined: frozenset[tuple[str, ...]]
    channel: frozenset[str]
    repeat: frozenset[str]
    denial: frozenset[str]
    neutral: frozenset[str]
    ordinal: Mapping[str, int]


def folded(text: str) -> str:
    """Small letters without accents, in one Unicode form; ä, ö, ü and ß as ae, oe, ue and ss."""
    text = unicodedata.normalize("NFKC", text).casefold()
    for letter, two in _UMLAUTS:
        text = text.replace(letter, two)
    return "".join(c for c in unicodedata.normalize("NFD", text) if not unicodedata.combining(c))


def without_elided(text: str) -> str:
    """Without articles and prepositions that have lost their vowel, as in `d'essieu`: no `d` that could mean right."""
    return _ELIDED.sub("", text)


def _spellings(word: str) -> set[tuple[str, ...]]:
    """A word or phrase as it may stand in a name: umlauts as two letters or without dots, elided words or none."""
    plain = "".join(c for c in unicodedata.normalize("NFD", word.casefold()) if not unicodedata.combining(c))
    spelled = (folded(word), plain.replace("ß", "ss"))
    return {tuple(re.findall(r"[a-z]+", text)) for one in spelled for text in (one, without_elided(one))}


@cache
def vocabulary() -> Vocabulary:
    """The lists of `vocabulary.toml`."""
    text = (files("sysid.first_look") / "vocabulary.toml").read_text(encoding="utf-8")
    lists = tomllib.loads(text)
    numbers, ordinals = lists.pop("number"), lists.pop("ordinal")
    meanings: dict[tuple[str, ...], list[Meaning]] = {}
    for attribute, values in lists.items():
        for value, words in values.items():
            pairs = [p.split(" = ") for p in attribute.split(", ")] if "=" in attribute else [(attribute, value)]
            meaning = dict(pairs)
            for word in words:
                for spelling in _spellings(word):
                    known = meanings.setdefault(spelling, [])
                    if meaning not in known:
                        known.append(meaning)
    joined = {("".join(words),): found for words, found in meanings.items() if len(words) > 1}
    sets = {
        key: frozenset(w for word in words for s in _spellings(word) for w in s[-1:]) for key, words in numbers.items()
    }
    named = {
        "".join(s): int(n) for n, words in ordinals.items() for w in words if w[0].isalpha() for s in _spellings(w)
    }
    both = {words: tuple(found) for words, found in (joined | meanings).items()}
    alone = frozenset(joined) - frozenset(meanings)
    return Vocabulary(both, alone, sets["channel"], sets["repeat"], sets["denial"], sets["neutral"], named)


@cache
def meanings(word: str) -> tuple[Meaning, ...]:
    """Meanings of one word in small letters: of itself, of its parts, or of the words that it begins; else none."""
    known = vocabulary().meanings
    if (word,) in known:
        return known[(word,)]
    for ending in _ENDINGS:
        stem = word.removesuffix(ending)
        if stem != word and len(stem) >= 4 and (stem,) in known:
            return known[(stem,)]
    return _of_compound(word) or _of_cut_off(word) or _of_part(word)


@cache
def phrase(words: tuple[str, ...]) -> tuple[Meaning, ...]:
    """Meanings of a phrase, also of one whose last word is cut off, as loggers do with long names; else none."""
    known = vocabulary().meanings
    if words in known or len(words[-1]) < _CUT_OFF:
        return known.get(words, ())
    found: list[Meaning] = []
    for other, of_other in known.items():
        if len(other) == len(words) and other[:-1] == words[:-1] and other[-1].startswith(words[-1]):
            found += [m for m in of_other if m not in found]
    return tuple(found) if len(found) == 1 else ()


def _of_compound(word: str) -> tuple[Meaning, ...]:
    """What all parts of a compound say together."""
    parts = min(_covers(word), key=lambda parts: (len(parts), -max(map(len, parts))), default=None)
    if parts is None or max(map(len, parts)) <= _IN_COMPOUND:
        return _of_codes(word)
    return _together([vocabulary().meanings.get((part,), ()) for part in parts])


def _of_codes(word: str) -> tuple[Meaning, ...]:
    """Two letters for an axle and two for a side, as in ``HAre``."""
    if len(word) != 4:
        return ()
    parts = [vocabulary().meanings.get((part,), ()) for part in (word[:2], word[2:])]
    ends = [m for m in parts[0] if "end" in m]
    sides = [m for m in parts[1] if "side" in m]
    return ({**ends[0], "side": sides[0]["side"]},) if len(ends) == len(sides) == 1 and len(parts[0]) == 1 else ()


def _together(of_parts: list[tuple[Meaning, ...]]) -> tuple[Meaning, ...]:
    """One meaning of parts of one meaning each, none where they contradict each other."""
    result: dict[str, str] = {}
    for found in of_parts:
        if len(found) != 1:
            continue
        for key, value in found[0].items():
            if result.setdefault(key, value) != value and key not in ("mount", "quantity", "load"):
                return ()
            # The head of a compound stands last; of two loads the first one says which.
            result[key] = result[key] if key == "load" else value
    return (result,) if result else ()


def _covers(word: str, first: bool = True) -> Iterator[tuple[str, ...]]:
    """All ways to write a word as known words, joined as in German."""
    known, neutral = vocabulary().meanings, vocabulary().neutral
    for length in range(len(word), _IN_COMPOUND - 1, -1):
        head = word[:length]
        if ((head,) not in known and head not in neutral) or (first and length == len(word)):
            continue
        if length == len(word):
            yield (head,)
            continue
        for link in _LINKS:
            rest = word[length:]
            if rest.startswith(link) and len(rest) - len(link) >= _IN_COMPOUND:
                for more in _covers(rest.removeprefix(link), False):
                    yield (head, *more)


def _of_cut_off(word: str) -> tuple[Meaning, ...]:
    """What all words say that begin with a word cut off; nothing where they say different things."""
    if len(word) < _CUT_OFF:
        return ()
    found: list[Meaning] = []
    for words, of_words in vocabulary().meanings.items():
        if len(words) == 1 and words[0].startswith(word) and words not in vocabulary().joined:
            found += [m for m in of_words if m not in found]
    return tuple(found) if len(found) == 1 else ()


def _of_part(word: str) -> tuple[Meaning, ...]:
    """What the longest known end or beginning of a word says of its place or quantity."""
    known = vocabulary().meanings
    parts = [(word[i:], word[:i]) for i in range(1, len(word) - _IN_UNKNOWN + 1)]
    parts += [(word[:i], "") for i in range(len(word) - 1, _IN_UNKNOWN - 1, -1)]
    for part, before in parts:
        if (part,) in known and before not in _NEGATIONS:
            return tuple(m for m in known[(part,)] if not _WHOLE & m.keys())
    return ()
