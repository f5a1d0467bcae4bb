"""From the text of a campaign file to validated tables; every fault becomes one plain sentence."""

from __future__ import annotations

import difflib
import re
import tomllib
import types
import typing
from typing import Any

from pydantic import BaseModel, ValidationError

from sysid.campaign.toml.bounds import check_bounds
from sysid.campaign.toml.schema import CampaignFile
from sysid.errors import CampaignError
from sysid.wording import finish, nearest, shorten

SHOWN = 3  # problems named in one error
_COMPARED = 100  # unknown keys compared with missing ones
_LONGEST_SLIP = 200  # characters of a text or line that a remedy is looked for in: patterns take the square of it
_Model = typing.TypeVar("_Model", bound=BaseModel)


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
    return validated(CampaignFile, _named_scans(data), label)


def validated(model: type[_Model], data: dict[str, Any], label: str) -> _Model:
    """Check parsed TOML against the tables of `model`.

    Raises
    ------
    CampaignError
        One sentence that names up to three problems, each with its key, what was found and the nearest valid name.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problems, count = _problems(error.errors(include_url=False), data, model)
    except RecursionError:
        problems, count = ["tables are nested too deeply"], 1
    more = f"; and {count - len(problems)} more" if count > len(problems) else ""
    raise CampaignError(finish(f"{label}: {'; '.join(problems)}{more}")) from None


def _named_scans(data: dict[str, Any]) -> dict[str, Any]:
    # [scan] with its own keys is the one bump of the campaign; [scan.NAME] tables are several.
    scan = data.get("scan")
    if isinstance(scan, dict) and scan and not all(isinstance(v, dict) for v in scan.values()):
        return {**data, "scan": {"bump": scan}}
    return data


def _problems(errors: list[Any], data: dict[str, Any], model: type[BaseModel]) -> tuple[list[str], int]:
    """Sentences about the first problems, and the number of all."""
    unknown = [e["loc"] for e in errors if e["type"] == "extra_forbidden"]
    told = []
    # Unknown keys first: a misspelled key is the cause, the missing one only its consequence.
    for error in sorted(errors, key=lambda e: e["type"] != "extra_forbidden"):
        loc = tuple(error["loc"])
        if error["type"] == "missing" and any(
            u[:-1] == loc[:-1] and difflib.SequenceMatcher(None, str(u[-1]), str(loc[-1])).ratio() > 0.5
            for u in unknown[:_COMPARED]
        ):
            continue
        told.append((error, loc))
    return [_sentence(error, loc, data, model) for error, loc in told[:SHOWN]], len(told)


def _sentence(error: Any, loc: tuple[str | int, ...], data: dict[str, Any], model: type[BaseModel]) -> str:
    kind, where = error["type"], _where(loc, data)
    given = _as_written(error.get("input"))
    if kind == "extra_forbidden":
        return f"{where} is not a known key; {nearest(loc[-1], _valid_keys(loc[:-1], model))}"
    if kind == "missing":
        return f"{where} is missing; add it"
    if kind == "value_error":
        return f"{where} {error['ctx']['error']}"
    if kind == "literal_error":
        options = [o.strip(" '") for o in error["ctx"]["expected"].replace(" or ", ", ").split(",")]
        return f"{where} is {given}, expected {error['ctx']['expected']}; {nearest(error.get('input'), options)}"
    expected = {
        "float_type": "a number",
        "int_type": "a whole number",
        "int_from_float": "a whole number",
        "finite_number": "a finite number",
        "string_type": "text in quotes",
        "bool_type": "true or false",
        "list_type": "a list",
        "dict_type": "a table",
        "model_type": "a table",
        "model_attributes_type": "a table",
    }.get(kind)
    if expected is None:
        expected = error["msg"][0].lower() + error["msg"][1:]
        expected = expected.replace("input should be ", "").replace(" should have", " with")
        if expected.startswith(("greater", "less")):
            expected = f"a number {expected}"
    return f"{where} is {given}, expected {shorten(expected, 120)}{_without_quotes(error.get('input'), expected)}"


def _without_quotes(value: object, expected: str) -> str:
    """What to do with text where a number, a list or a table is expected; empty where nothing is known to do."""
    if not isinstance(value, str) or len(value) > _LONGEST_SLIP:
        return ""
    if expected == "a table":
        none = value.strip().lower() in ("", "none", "no", "nothing")
        return "; delete this line if there is none" if none else "; write it in braces without quotes"
    number = r"[+-]?\d+(?:\.\d+)?"
    if expected == "a list":
        numbers = re.fullmatch(rf"\s*\[?\s*({number}(?:\s*[,;\s]\s*{number})*)\s*\]?\s*", value)
        return f"; write [{', '.join(re.findall(number, numbers[1]))}] without quotes" if numbers else ""
    bare = expected.endswith("number") and re.fullmatch(rf"\s*({number})\s*", value.replace(",", "."))
    return f"; write {bare[1]} without quotes" if bare else ""


def _as_written(value: object) -> str:
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) >= 10**15:
        return "a huge number"
    return f"'{shorten(value)}'" if isinstance(value, str) else shorten(value)


def _where(loc: tuple[str | int, ...], data: dict[str, Any]) -> str:
    """Key path with entries counted from 1, and the name of the entry where it has one."""
    path, label, at = "", "", typing.cast(Any, data)
    for part in loc:
        path += f"[{part + 1}]" if isinstance(part, int) else f"{'.' if path else ''}{shorten(part, 40)}"
        try:
            at = at[part]
        except (KeyError, IndexError, TypeError):
            at = None
        if isinstance(part, int) and isinstance(at, dict):
            label = next((str(at[k]) for k in ("name", "file", "case") if isinstance(at.get(k), str)), "")
    return f"{path} ('{shorten(label)}')" if label else path


def _valid_keys(loc: tuple[str | int, ...], model: type[BaseModel]) -> list[str]:
    """Keys of the table at a location, found by walking the types of the schema."""
    at: Any = model
    for part in loc:
        at = _step(at, part)
    return [f.alias or name for name, f in at.model_fields.items()] if _is_table(at) else []


def _is_table(at: Any) -> bool:
    return isinstance(at, type) and issubclass(at, BaseModel)


def _step(at: Any, part: str | int) -> Any:
    if _is_table(at):
        field = at.model_fields.get(part)
        return _bare(field.annotation) if field is not None else None
    arguments = typing.get_args(at)
    if typing.get_origin(at) in (list, dict) and arguments:
        return _bare(arguments[-1])
    return None


def _bare(annotation: Any) -> Any:
    while typing.get_origin(annotation) in (typing.Annotated, typing.Union, types.UnionType):
        arguments = [a for a in typing.get_args(annotation) if a is not type(None)]
        annotation = arguments[0]
    return annotation
