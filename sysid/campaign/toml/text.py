"""Values, keys, tables and comments as TOML writes them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from sysid.campaign.toml.todo import MARK

_BARE = re.compile(r"^[A-Za-z0-9_-]+$")
#: Comments stand in one column where the lines before them are no longer than this.
_ALIGNED = 100


def quoted(value: str) -> str:
    """A text as TOML writes it: its basic strings are those of JSON, but for the delete character."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_key(name: str) -> str:
    """A key, in quotes where it needs them."""
    return name if _BARE.match(name) else quoted(name)


def value_text(value: Any) -> str:
    """A number, text, list or table on one line."""
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{toml_key(k)} = {value_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(value_text, value)) + "]"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def todo(what: str) -> str:
    """A value that somebody has to fill in."""
    return f"{MARK}: {what}"


def section(name: str, lines: Iterable[str], *, array: bool = False) -> str:
    """A table, or with `array` one of several of a name."""
    head = f"[[{name}]]" if array else f"[{name}]"
    return "\n".join([head, *lines]) + "\n"


def commented(lines: Sequence[tuple[str, str]], indent: str = "") -> list[str]:
    """Lines with their comments in one column."""
    width = max((len(line) for line, _ in lines if len(line) <= _ALIGNED), default=0)
    return [f"{indent}{line.ljust(width)}  # {said}" if said else f"{indent}{line}" for line, said in lines]


def banner(title: str) -> str:
    """A comment that begins a part of the file."""
    return f"# {'-' * 64} {title}\n"
