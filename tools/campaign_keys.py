"""The keys of every table of a campaign file, as its schema has them: ``python -m tools.campaign_keys``."""

from __future__ import annotations

import json
import types
import typing
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from sysid.campaign.toml import keys
from sysid.campaign.toml.schema import CampaignFile

FILE = Path(keys.__file__).with_name("keys.json")


def main() -> None:
    """Write the file that the program reads."""
    FILE.write_text(json.dumps(tables(CampaignFile), indent=1) + "\n", encoding="utf-8")


def tables(model: type[BaseModel]) -> dict[str, dict[str, list[str] | None]]:
    """Keys by table, of `model` and all below it; with a key that leads to tables: how, and to which."""
    found: dict[str, dict[str, list[str] | None]] = {}
    waiting = [model]
    while waiting:
        table = waiting.pop()
        if table.__name__ in found:
            continue
        found[table.__name__] = keys_of = {}
        for name, field in table.model_fields.items():
            kind, below = _leads_to(field.annotation)
            keys_of[field.alias or name] = None if below is None else [kind, below.__name__]
            waiting += [] if below is None else [below]
    return found


def _leads_to(annotation: Any) -> tuple[str, type[BaseModel] | None]:
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _leads_to(arguments[0])
    if origin in (typing.Union, types.UnionType):
        return next((found for found in map(_leads_to, arguments) if found[1] is not None), ("", None))
    if origin in (list, dict):
        kind, below = _leads_to(arguments[-1])
        return ("list" if origin is list else "named", below) if kind == "table" else ("", None)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table", annotation
    return "", None


if __name__ == "__main__":
    main()
