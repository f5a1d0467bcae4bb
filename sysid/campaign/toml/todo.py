"""Values of a campaign file that are still missing: ``"TODO: what"`` in place of a value."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from sysid.errors import CampaignError
from sysid.wording import shorten

#: How such a value begins, and how a comment on a guess to be confirmed begins.
MARK = "TODO"
CONFIRM = "TODO confirm"
_CONFIRM_LINE = re.compile(rf"^(?P<entry>.*?)#\s*{CONFIRM}:?\s*(?P<what>.*)$")
_HEADER = re.compile(r"^\s*\[+([^\]]+)\]+")
_NAME = re.compile(r'^\s*name\s*=\s*"([^"]*)"')
_FILE = re.compile(r'\bfile = "([^"]*)"')
#: Values to fill in that one message names.
_SHOWN = 5


@dataclass(frozen=True)
class Todo:
    """One missing value: its place as a path of keys (lists from 0), the path in words, and what is required."""

    path: tuple[str | int, ...]
    where: str
    what: str


@dataclass(frozen=True)
class Doubt:
    """One guess to confirm: line of the file from 1, the entry in it, and what is in doubt."""

    line: int
    entry: str
    what: str


def is_todo(value: object) -> bool:
    """Whether a value is still to be filled in."""
    return isinstance(value, str) and value.strip().startswith(MARK)


def find_todos(tables: Mapping[str, Any]) -> tuple[Todo, ...]:
    """All values of parsed tables that are still to be filled in, in the order of the file."""
    return tuple(_walk(tables, (), ""))


def find_doubts(text: str) -> tuple[Doubt, ...]:
    """All lines whose comment asks to confirm a guess."""
    doubts = []
    table = ""
    for number, line in enumerate(text.splitlines(), start=1):
        header = _HEADER.match(line)
        table = header[1] if header else table
        name = _NAME.match(line)
        if name and table.count("'") == 0:
            table = f"{table} '{shorten(name[1], 60)}'"
        match = _CONFIRM_LINE.match(line)
        if match:
            file = _FILE.search(match["entry"])
            key = re.split(r"\s*=", match["entry"].strip(), maxsplit=1)[0].strip(" {,")
            entry = file[1] if file else f"{table}.{key}" if key else table
            doubts.append(Doubt(number, shorten(entry, 80), match["what"].strip()))
    return tuple(doubts)


def refuse_todos(tables: Mapping[str, Any], label: str) -> None:
    """Refuse a file that is not finished.

    Raises
    ------
    CampaignError
        If values are still to be filled in; the first of them are named.
    """
    left = find_todos(tables)
    if left:
        some = ", ".join(todo.where for todo in left[:_SHOWN]) + (", ..." if len(left) > _SHOWN else "")
        values = "1 value" if len(left) == 1 else f"{len(left)} values"
        raise CampaignError(f"{label} has {values} to fill in ({some}); 'check' lists what belongs there.")


def _walk(value: Any, path: tuple[str | int, ...], where: str) -> Iterator[Todo]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _walk(inner, (*path, key), f"{where}.{shorten(key, 60)}" if where else shorten(key, 60))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            name = (
                next((inner[k] for k in ("name", "file") if k in inner), None) if isinstance(inner, Mapping) else None
            )
            said = f" ('{shorten(name, 60)}')" if isinstance(name, str) and not is_todo(name) else ""
            yield from _walk(inner, (*path, i), f"{where}[{i + 1}]{said}")
    elif is_todo(value):
        yield Todo(path, where, value.strip().removeprefix(MARK).lstrip(": "))
