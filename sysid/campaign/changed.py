"""Another vehicle, law or test from Python: a campaign file with other values, written beside the first."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sysid.campaign.inputs.paths import campaign_file
from sysid.campaign.toml.text import section, toml_key, value_text
from sysid.errors import CampaignError
from sysid.files import write_text

#: A part of a key: a name, in quotes if it holds a dot or a bracket, or the number of an entry, the first one 1.
_PART = re.compile(r"""\.?(?:"([^"]+)"|([^."\[\]]+))|\[(\d+)\]""")


def changed_campaign(campaign: str | Path, name: str, changes: Mapping[str, Any]) -> Path:
    """Write a campaign file with other values into the folder of another one, and return its path.

    Logs and scans are found from there as before. The file is an ordinary one: the command line takes it too, and its
    hash is that of the results.

    Parameters
    ----------
    campaign : the campaign file or its folder.
    name : of the new file, for example ``stiffer.toml``; a file of that name is replaced, but not `campaign` itself.
    changes : new values by their keys as messages write them, ``vehicle.axle[4].suspension_law``, axles and runs
        counted from 1; the entry after the last one is a new one. A value is a number, text, list, array or table
        (mapping); None removes the key.

    Raises
    ------
    CampaignError
        If a key leads nowhere, the new file would be wrong, or `name` is no name for it.
    """
    from sysid.campaign.toml.reading import validate

    content = campaign_file(campaign)
    target = content.path.parent / name
    if Path(name).name != name or target.suffix != ".toml" or target.resolve() == content.path.resolve():
        raise CampaignError(f"'{name}' is no name for the changed file; give another one that ends with .toml.")
    tables = tomllib.loads(content.data.decode("utf-8"))
    for key, value in changes.items():
        _set(tables, key, value)
    validate(copy.deepcopy(tables), name)
    write_text(target, tables_text(tables))
    return target


def tables_text(tables: Mapping[str, Any]) -> str:
    """The text of a campaign file with these tables."""
    return "\n".join(_tables("", tables))


def _steps(key: str) -> list[str | int]:
    steps: list[str | int] = []
    at = 0
    while at < len(key) or not steps:
        part = _PART.match(key, at)
        if part is None:
            raise CampaignError(f"'{key}' is no key; write it as vehicle.axle[4].suspension_law.")
        steps.append(int(part[3]) - 1 if part[3] else part[1] or part[2])
        at = part.end()
    return steps


def _set(tables: dict[str, Any], key: str, value: Any) -> None:
    *before, last = _steps(key)
    place: Any = tables
    for step in before:
        if isinstance(place, dict) and isinstance(step, str):
            place = place.setdefault(step, {})
        elif isinstance(place, list) and isinstance(step, int) and 0 <= step < len(place):
            place = place[step]
        else:
            raise CampaignError(f"'{key}' leads nowhere: the campaign file has no such entry.")
    entries = len(place) + (value is not None) if isinstance(place, list) else 0
    if not (isinstance(place, dict) if isinstance(last, str) else 0 <= last < entries):
        raise CampaignError(f"'{key}' leads nowhere: the campaign file has no such entry.")
    if value is None:
        place.pop(last, None) if isinstance(place, dict) else place.pop(last)
    elif isinstance(place, list) and last == len(place):
        place.append(_plain(value))
    else:
        place[last] = _plain(value)


def _plain(value: Any) -> Any:
    """A value of TOML: arrays and numbers of NumPy as lists and numbers."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value


def _tables(name: str, table: Mapping[str, Any]) -> Iterator[str]:
    """A table and those below it; lists of tables each under a heading of its own."""
    below = {k: v for k, v in table.items() if isinstance(v, Mapping) or _of_tables(v)}
    lines = [f"{toml_key(k)} = {value_text(v)}" for k, v in table.items() if k not in below]
    yield section(name, lines) if name else "\n".join(lines) + "\n"
    for key, value in below.items():
        inner = f"{name}.{toml_key(key)}" if name else toml_key(key)
        if isinstance(value, Mapping):
            yield from _tables(inner, value)
            continue
        for entry in value:
            yield section(inner, [f"{toml_key(k)} = {value_text(v)}" for k, v in entry.items()], array=True)


def _of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)
