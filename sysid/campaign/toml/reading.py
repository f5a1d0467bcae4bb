"""From the text of a campaign file to validated tables; every fault becomes one plain sentence."""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING, Any

from sysid.campaign.toml.bounds import check_bounds
from sysid.campaign.toml.keys import refuse_unknown_keys
from sysid.errors import CampaignError
from sysid.wording import shorten

if TYPE_CHECKING:
    from sysid.campaign.toml.schema import CampaignFile

_LONGEST_SLIP = 200  # characters of a line that a remedy is looked for in: patterns take the square of it


def parse_toml(content: bytes, label: str) -> dict[str, Any]:
    """Decode and parse a TOML file.

    Parameters
    ----------
    content : the bytes of the file: UTF-8 with or without byte order mark, or UTF-16 with one.
    label : name of the file for messages.

    Raises
    ------
    CampaignError
        If it is not text, beyond the bounds of `sysid.limits`, or not TOML; line and column are named.
    """
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        raise CampaignError(f"{label} is not UTF-8 text (byte {error.start + 1}); save it as UTF-8.") from None
    check_bounds(text, label)
    try:
        return tomllib.loads(text.replace("\r\n", "\n"))
    except tomllib.TOMLDecodeError as error:
        remedy = _remedy(text, str(error))
        raise CampaignError(f"{label} is not valid TOML: {shorten(error, 200)}; {remedy}.") from None
    except (ValueError, OverflowError, RecursionError):
        raise CampaignError(
            f"{label} is not valid TOML: a number is too long or tables are nested too deeply; correct it."
        ) from None


def _remedy(text: str, error: str) -> str:
    """What to do about the line that an error names: decimal commas and paths of Windows are told apart."""
    at = re.search(r"at line (\d+)", error)
    lines = text.splitlines()
    line = lines[int(at[1]) - 1] if at and int(at[1]) <= len(lines) else ""
    # Behind an equals sign and no bracket, a comma between digits separates nothing.
    comma = re.search(r"=\s*([+-]?\d+),(\d+)\s*(?:[,}#]|$)", line) if len(line) < _LONGEST_SLIP else None
    if comma:
        return f"write a decimal point: {comma[1]}.{comma[2]}"
    return "write / in place of \\ in the names of files" if "\\" in line else "correct that line"


def validate(data: dict[str, Any], label: str) -> CampaignFile:
    """Check parsed TOML against schema 1.

    Raises
    ------
    CampaignError
        One sentence that names up to three problems, each with its key, what was found and the nearest valid name.
    """
    version = data.get("schema")
    if version != 1 or isinstance(version, bool):
        found = f"schema = {shorten(version)}" if "schema" in data else "no schema"
        raise CampaignError(f"{label} has {found}, this program reads 'schema = 1'; put that line at the top.")
    tables = _named_scans(data)
    refuse_unknown_keys(tables, label)
    # They take longer to load than all before.
    from sysid.campaign.toml.errors import validated
    from sysid.campaign.toml.schema import CampaignFile

    return validated(CampaignFile, tables, label)


def _named_scans(data: dict[str, Any]) -> dict[str, Any]:
    # [scan] with its own keys is the one bump of the campaign; [scan.NAME] tables are several.
    scan = data.get("scan")
    if isinstance(scan, dict) and scan and not all(isinstance(v, dict) for v in scan.values()):
        return {**data, "scan": {"bump": scan}}
    return data
