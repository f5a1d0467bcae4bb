"""Words that the sentences of this package share."""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Iterable, Sequence

#: General categories of what a reader does not see: control characters, which terminals obey, marks that
#: change the direction of writing, halves of surrogate pairs, private characters, separators of lines.
_UNSEEN = ("Cc", "Cf", "Cs", "Co", "Zl", "Zp")
#: Not seen either, and part of how words are written in Persian, Hindi and other scripts: ZWNJ and ZWJ.
JOINERS = "\u200c\u200d"
_KEPT = f"\n\t{JOINERS}"


def plain_text(text: str) -> str:
    """`text` without what a reader does not see and programs obey; line breaks and tabs are kept.

    Every text that others may have written comes through here on its way to a terminal, a page, a figure or a table.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(c for c in text if c in _KEPT or unicodedata.category(c) not in _UNSEEN)


def plain_line(text: str) -> str:
    """:func:`plain_text` on one line."""
    if text.isascii() and text.isprintable():
        return text
    return plain_text("".join(" " if c.isspace() or unicodedata.category(c) == "Cc" else c for c in text))


def shorten(text: object, limit: int = 60) -> str:
    """Text fit for one line of an error: control characters escaped, cut at `limit` characters."""
    line = "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text)[: limit + 1])
    return line if len(line) <= limit else line[: limit - 3] + "..."


def nearest(name: object, valid: Iterable[str]) -> str:
    """Half a sentence naming the nearest valid name, or the valid names where none is near."""
    names = list(valid)
    text = str(name)[:200]
    folded = {n.casefold(): n for n in names}
    near = difflib.get_close_matches(text.casefold(), folded, n=1, cutoff=0.5)
    if near:
        return f"did you mean '{shorten(folded[near[0]])}'"
    listed = ", ".join(f"'{shorten(n)}'" for n in names[:12]) + (", ..." if len(names) > 12 else "")
    return f"use one of {listed}" if names else "there is none to choose from"


def joined_words(items: Sequence[str]) -> str:
    """``a, b and c``."""
    return " and ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)


def finish(sentence: str) -> str:
    """The sentence with a full stop, or a question mark if it ends in a suggestion."""
    last = sentence.rsplit("; ", 1)[-1]
    return sentence + ("?" if last.startswith("did you mean") else ".")


def say_once(messages: Sequence[tuple[str, str]]) -> list[str]:
    """Sentences about files, pairs (file, "file: sentence"); one that more than two files share is said once."""
    files: dict[str, list[str]] = {}
    for file, message in messages:
        files.setdefault(message.removeprefix(f"{file}: "), []).append(file)
    said: dict[str, None] = {}
    for file, message in messages:
        sentence = message.removeprefix(f"{file}: ")
        shared = files[sentence]
        said[message if len(shared) <= 2 else f"{len(shared)} logs ({shared[0]} and others): {sentence}"] = None
    return list(said)
