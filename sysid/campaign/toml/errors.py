"""What is wrong with the tables of a campaign file, in one plain sentence."""

from __future__ import annotations

import difflib
import re
import types
import typing
from typing import Any

from pydantic import BaseModel, ValidationError

from sysid.campaign.toml.keys import SHOWN, one_sentence, unknown_key, where
from sysid.wording import nearest, shorten

_COMPARED = 100  # unknown keys compared with missing ones
_LONGEST_SLIP = 200  # characters of a text or line that a remedy is looked for in: patterns take the square of it
_Model = typing.TypeVar("_Model", bound=BaseModel)


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
    raise one_sentence(label, problems, count) from None


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
    kind, at = error["type"], where(loc, data)
    given = _as_written(error.get("input"))
    if kind == "extra_forbidden":
        return unknown_key(loc, data, _valid_keys(loc[:-1], model))
    if kind == "missing":
        return f"{at} is missing; add it"
    if kind == "value_error":
        return f"{at} {error['ctx']['error']}"
    if kind == "literal_error":
        options = [o.strip(" '") for o in error["ctx"]["expected"].replace(" or ", ", ").split(",")]
        return f"{at} is {given}, expected {error['ctx']['expected']}; {nearest(error.get('input'), options)}"
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
    return f"{at} is {given}, expected {shorten(expected, 120)}{_without_quotes(error.get('input'), expected)}"


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
