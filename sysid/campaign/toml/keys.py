"""Keys of a campaign file by table, known without its schema: a misspelled one is said before anything is loaded.

`keys.json` is written by ``python -m tools.campaign_keys``.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from importlib.resources import files
from typing import Any

from sysid.errors import CampaignError
from sysid.wording import finish, nearest, shorten

#: Problems named in one error.
SHOWN = 3
#: Keys, and indices of entries from 0, from the whole file to a value.
Location = tuple[str | int, ...]


def refuse_unknown_keys(data: dict[str, Any], label: str) -> None:
    """Refuse a campaign file with keys that no table has.

    Raises
    ------
    CampaignError
        One sentence that names up to three of them, each with the nearest valid name.
    """
    tables = json.loads((files("sysid.campaign.toml") / "keys.json").read_text(encoding="utf-8"))
    unknown = list(_unknown(data, "CampaignFile", tables, ()))
    if unknown:
        raise one_sentence(label, [unknown_key(loc, data, keys) for loc, keys in unknown[:SHOWN]], len(unknown))


def _unknown(at: Any, table: str, tables: dict[str, Any], loc: Location) -> Iterator[tuple[Location, Collection[str]]]:
    """Places of unknown keys in a table and those below it, each with the keys that it might be."""
    if not isinstance(at, dict):
        return
    keys = tables[table]
    yield from (((*loc, key), keys) for key in at if key not in keys)
    for key, value in at.items():
        kind, below = keys.get(key) or ("", "")
        entries: list[tuple[Any, Any]] = [(None, value)] if kind == "table" else []
        if kind == "named" and isinstance(value, dict):
            entries = list(value.items())
        elif kind == "list" and isinstance(value, list):
            entries = list(enumerate(value))
        for name, entry in entries:
            yield from _unknown(entry, below, tables, (*loc, key) if name is None else (*loc, key, name))


def unknown_key(loc: Location, data: Any, known: Collection[str]) -> str:
    """Half a sentence about a key that its table does not have."""
    return f"{where(loc, data)} is not a known key; {nearest(loc[-1], known)}"


def one_sentence(label: str, problems: Sequence[str], count: int) -> CampaignError:
    """The error that names `problems`, the first of `count`."""
    more = f"; and {count - len(problems)} more" if count > len(problems) else ""
    return CampaignError(finish(f"{label}: {'; '.join(problems)}{more}"))


def where(loc: Location, data: Any) -> str:
    """Key path with entries counted from 1, and the name of the entry where it has one."""
    path, label, at = "", "", data
    for part in loc:
        path += f"[{part + 1}]" if isinstance(part, int) else f"{'.' if path else ''}{shorten(part, 40)}"
        try:
            at = at[part]
        except (KeyError, IndexError, TypeError):
            at = None
        if isinstance(part, int) and isinstance(at, dict):
            label = next((str(at[k]) for k in ("name", "file", "case") if isinstance(at.get(k), str)), "")
    return f"{path} ('{shorten(label)}')" if label else path
