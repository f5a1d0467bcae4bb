"""Which result a file is from: run, hash and date, the same in everything that is written of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

#: Keys of `result.json` that differ between runs with the same result.
_OF_THE_RUN = ("timings", "identity", "Comment")


@dataclass(frozen=True)
class Identity:
    """`run`: short hash of inputs, options and versions; `result_sha256`: of the content of `result.json` without
    times; `date`: when the last stage was computed (ISO 8601, UTC), empty where it is not known; `inputs_sha256`: of
    the names and hashes of the input files.
    """

    run: str
    result_sha256: str
    date: str
    inputs_sha256: str

    @property
    def line(self) -> str:
        """All of them on one line, for comments and footers."""
        date = f", {self.date}" if self.date else ""
        return f"sysid run {self.run}{date}, inputs sha256 {self.inputs_sha256}, result sha256 {self.result_sha256}"


def identity_of(document: Mapping[str, Any]) -> Identity:
    """The identity of the result whose `result.json` has this content.

    Parameters
    ----------
    document : content as plain Python objects.
    """
    made = {key: document.get(key) for key in ("campaign", "inputs", "seed", "status", "versions")}
    stamp = document.get("identity")
    date = stamp.get("date") if isinstance(stamp, dict) else None
    date = date if isinstance(date, str) else ""
    return Identity(_digest(made)[:12], content_sha256(document), date, _digest(document.get("inputs")))


def content_sha256(document: Mapping[str, Any]) -> str:
    """SHA-256 of the content of a `result.json` without what differs between runs with the same result."""
    return _digest({key: value for key, value in document.items() if key not in _OF_THE_RUN})


def _digest(content: Mapping[str, Any] | None) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def stamped(name: str, text: str, identity: Identity) -> str:
    """The text of a file with the identity of its result, and its own hash, where its format has a place for remarks.

    The hash is that of the text without them, in JSON that of the content without its comment.

    SVG has its metadata, LS-DYNA a comment, Chrono the key ``Comment``, HTML a ``meta`` element. CSV has none: for it,
    and for all others, :mod:`sysid.export.file_list` says which result they are from.

    Parameters
    ----------
    name : of the file; its ending decides.
    """
    document = json.loads(text) if name.endswith(".json") else {}
    own = content_sha256(document) if document else hashlib.sha256(text.encode()).hexdigest()
    line = f"{identity.line}, own sha256 {own}"
    if name.endswith(".svg"):
        begin = text.index(">", text.index("<svg")) + 1
        return f"{text[:begin]}\n <desc>{line}</desc>{text[begin:]}"
    if name.endswith(".k"):
        # A line of a deck has at most 80 columns.
        head, rest = text.split("\n", 1)
        return "\n".join([head, *(f"$ {part}" for part in line.split(", ")), rest])
    if name.endswith(".html"):
        meta = '<meta charset="utf-8">'
        return text.replace(meta, f'{meta}\n<meta name="generator" content="{line}">', 1)
    if name.endswith(".json"):
        document["Comment"] = f"{document.get('Comment', '').rstrip('.')}. {line}.".lstrip(". ")
        return json.dumps(document, indent=2, allow_nan=False) + "\n"
    return text
