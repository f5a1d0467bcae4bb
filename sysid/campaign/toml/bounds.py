"""Bounds on the text of a campaign file, checked before parsing: long keys and deep tables need gigabytes."""

from __future__ import annotations

import re

from sysid import limits
from sysid.errors import CampaignError

# Possessive and from the start of a key only: nothing is read twice, for any content of the file.
_LONG_KEY = re.compile(rf"(?<![\w-])[\w-]{{{limits.KEY_LENGTH + 1}}}")
_MANY_PARTS = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{limits.KEY_PARTS}}}")
_OPENING = re.compile(r"[\"'#]")
_BRACKET = re.compile(r"[\[\]{}]")


def check_bounds(text: str, label: str) -> None:
    """Refuse a TOML text with keys, nesting or numbers of entries that no campaign needs.

    Raises
    ------
    CampaignError
        If a key has more parts or characters, tables are nested deeper, or there are more keys or list entries than
        `sysid.limits` allows; the line is named where there is one.
    """
    bare = _without_strings(text)
    for pattern, what in (
        (_LONG_KEY, f"more than {limits.KEY_LENGTH} characters in one word without quotes"),
        (_MANY_PARTS, f"a key with more than {limits.KEY_PARTS} parts"),
    ):
        match = pattern.search(bare)
        if match:
            line = bare.count("\n", 0, match.start()) + 1
            raise CampaignError(f"{label}, line {line}, has {what}; correct it.")
    deepest, line = _deepest(bare)
    if deepest > limits.NESTING:
        raise CampaignError(
            f"{label}, line {line}: lists or tables are nested too deeply (more than {limits.NESTING}); correct it."
        )
    counted = (("=", limits.KEYS, "keys"), ("[", limits.KEYS, "tables"), (",", limits.LIST_ENTRIES, "entries"))
    for sign, most, what in counted:
        count = bare.count(sign)
        if count > most:
            raise CampaignError(f"{label} has {count} {what}, at most {most} are read; is it a log?")


def _without_strings(text: str) -> str:
    """The text without comments, and with ``s`` for every string; line ends stay.

    It ends at a string that is never closed, where the parser stops as well.
    """
    pieces, at = [], 0
    while match := _OPENING.search(text, at):
        begin = match.start()
        pieces.append(text[at:begin])
        end = _end(text, begin)
        if end < 0:
            return "".join(pieces)
        skipped = text[begin:end]
        pieces.append(("" if skipped[0] == "#" else "s") + "\n" * skipped.count("\n"))
        at = end
    pieces.append(text[at:])
    return "".join(pieces)


def _end(text: str, begin: int) -> int:
    """Index past the comment or string that begins here, -1 if the string is never closed."""
    mark = text[begin]
    if mark == "#":
        end = text.find("\n", begin)
        return len(text) if end < 0 else end
    delimiter = mark * 3 if text.startswith(mark * 3, begin) else mark
    at = begin + len(delimiter)
    while (end := text.find(delimiter, at)) >= 0:
        # An odd number of backslashes before a double quotation mark makes it part of the string.
        slashes = 0
        while mark == '"' and text[end - 1 - slashes] == "\\" and end - 1 - slashes >= at:
            slashes += 1
        if slashes % 2 == 0:
            break
        at = end + 1
    if end < 0 or (len(delimiter) == 1 and "\n" in text[begin:end]):
        return -1
    end += len(delimiter)
    # Up to two further marks belong to a string of many lines: """"quoted"""".
    while len(delimiter) == 3 and end < len(text) and text[end] == mark:
        end += 1
    return end


def _deepest(bare: str) -> tuple[int, int]:
    depth = deepest = at = 0
    for match in _BRACKET.finditer(bare):
        depth += 1 if match[0] in "[{" else -1
        if depth > deepest:
            deepest, at = depth, match.start()
    return deepest, bare.count("\n", 0, at) + 1
