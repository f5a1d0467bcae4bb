"""Keys of a campaign file are known without its schema, and are those of the schema."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from sysid.campaign.toml.errors import validated
from sysid.campaign.toml.keys import refuse_unknown_keys
from sysid.campaign.toml.schema import CampaignFile
from sysid.errors import CampaignError
from tools import campaign_keys

ROOT = Path(__file__).resolve().parents[2]
#: A file with most tables; [scan] has a name, as the reader gives it.
TABLES = {
    **tomllib.loads((ROOT / "data" / "campaign.toml").read_text(encoding="utf-8")),
    "logger": [{"name": "one"}],
    "bridge": {"canal": {"spans_m": [20.0], "surface": {"class": "B"}}},
    "priors": {"k_1": {"median": 1.0, "log_sd": 0.2}},
}
TABLES["scan"] = {"bump": TABLES["scan"]}


def test_the_file_of_keys_is_that_of_the_schema() -> None:
    stored = json.loads(campaign_keys.FILE.read_text(encoding="utf-8"))
    assert stored == campaign_keys.tables(CampaignFile), "write it again: python -m tools.campaign_keys"
    # Pydantic itself says which keys its tables have, and to which others they lead.
    schema = CampaignFile.model_json_schema()
    tables = {"CampaignFile": schema, **schema["$defs"]}
    assert {name: set(table["properties"]) for name, table in tables.items()} == {n: set(k) for n, k in stored.items()}
    for name, table in tables.items():
        for key, value in table["properties"].items():
            leads_to = re.findall(r"#/\$defs/(\w+)", json.dumps(value))
            assert leads_to == ([] if stored[name][key] is None else [stored[name][key][1]]), (name, key)


def _places(at: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """All tables of a file, but those whose keys are names."""
    named = path in {("load_case",), ("scan",), ("bridge",), ("priors",)} or (
        path[:1] == ("sensors",) and len(path) == 2
    )
    below = at.items() if isinstance(at, dict) else enumerate(at) if isinstance(at, list) else ()
    own = [path] if isinstance(at, dict) and not named else []
    return own + [place for key, value in below for place in _places(value, (*path, key))]


@pytest.mark.parametrize(
    "place", sorted({tuple(0 if isinstance(p, int) else p for p in q) for q in _places(TABLES)}, key=str)
)
def test_a_misspelled_key_of_any_table_is_said_in_the_words_of_the_schema(place: tuple[str | int, ...]) -> None:
    refuse_unknown_keys(TABLES, "campaign.toml")
    tables = json.loads(json.dumps(TABLES, default=str))
    at = tables
    for part in place:
        at = at[part]
    at["unsprong_mass_kg"] = 1.0
    with pytest.raises(CampaignError) as early:
        refuse_unknown_keys(tables, "campaign.toml")
    with pytest.raises(CampaignError) as late:
        validated(CampaignFile, tables, "campaign.toml")
    assert "unsprong_mass_kg" in str(early.value)
    # It goes on with other problems.
    assert str(late.value).startswith(str(early.value)[:-1])


def test_tables_where_none_belongs_are_left_to_the_schema() -> None:
    refuse_unknown_keys({"vehicle": [1], "load_case": 3, "tests": {"bump_run": {"case": 1}, "plank_drop": [2]}}, "x")
