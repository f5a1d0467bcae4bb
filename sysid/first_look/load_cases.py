"""Load cases of a campaign by the words in the paths of its logs; what no path says is left open."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from sysid.first_look.file_words import LoadSaid, PathSays

#: The only load case of logs whose paths say none.
AS_TESTED = "as_tested"
_ORDER = ("empty", "partly", "half", "laden", "overload")


@dataclass(frozen=True)
class LoadCaseGuess:
    """A load case: what the truck carries (see :class:`sysid.first_look.file_words.LoadSaid`), and what is in doubt."""

    kind: str | None
    doubt: str = ""


@dataclass(frozen=True)
class CaseOfFile:
    """Load case of one log, None where it is not known, and reasons to look at it."""

    name: str | None
    why: tuple[str, ...] = ()


@dataclass(frozen=True)
class LoadCases:
    """Load cases by name, with the least load first, and that of every log."""

    names: Mapping[str, LoadCaseGuess]
    of_file: Mapping[str, CaseOfFile]


def load_cases_of(said: Mapping[str, PathSays]) -> LoadCases:
    """Load cases that the paths of logs say.

    A log whose path says none belongs to none if others say theirs; if no path says any, all logs are of one.
    """
    loads: dict[tuple[str | None, str], list[LoadSaid]] = {}
    for of_path in said.values():
        if of_path.load is not None:
            loads.setdefault(_case(of_path.load), []).append(of_path.load)
    if not loads:
        doubt = "no path says a load case, so all drops and runs are taken for one"
        return LoadCases({AS_TESTED: LoadCaseGuess(None, doubt)}, {file: CaseOfFile(AS_TESTED) for file in said})
    name_of = {case: _name(of_case) for case, of_case in loads.items()}
    names = {
        name_of[case]: LoadCaseGuess(case[0], _doubt(case[0], loads[case])) for case in sorted(loads, key=_by_load)
    }
    of_file = {file: _of_file(of_path, name_of) for file, of_path in said.items()}
    return LoadCases(names, of_file)


def _case(load: LoadSaid) -> tuple[str | None, str]:
    """What makes two paths say the same load case: the load, or the word where it says no certain one."""
    return load.kind, load.word if load.kind in (None, "partly") else ""


def _doubt(kind: str | None, of_case: list[LoadSaid]) -> str:
    if kind is None:
        return "nothing says how much of its load this is"
    if not any(load.sure for load in of_case):
        return f"'{of_case[0].word}' may be the laden truck or any load"
    others = sorted({load.word for load in of_case} - {_name(of_case)})
    return f"also called {' and '.join(map(repr, others))}" if others else ""


def _name(of_case: list[LoadSaid]) -> str:
    return Counter(load.word for load in of_case).most_common(1)[0][0]


def _of_file(said: PathSays, name_of: Mapping[tuple[str | None, str], str]) -> CaseOfFile:
    if said.load is None:
        return CaseOfFile(None)
    why = (f"its path says {' and '.join(said.contradicts)}",) if said.contradicts else ()
    return CaseOfFile(name_of[_case(said.load)], why)


def _by_load(case: tuple[str | None, str]) -> tuple[int, float, str]:
    number = re.search(r"\d+(?:\.\d+)?", case[1])
    value = float(number[0]) * (0.001 if "kg" in case[1] else 1.0) if number else 0.0
    return _ORDER.index(case[0]) if case[0] in _ORDER else len(_ORDER), value, case[1]
