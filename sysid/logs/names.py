"""Names of channels: how their bytes become text, and the form in which they are compared."""

from __future__ import annotations

import unicodedata


def normal_name(name: str) -> str:
    """The name with composed letters (Unicode NFC): some systems write an umlaut as one character, others as two."""
    return unicodedata.normalize("NFC", name)


def decoded(data: bytes) -> str:
    """Text of a file that does not say its encoding: UTF-8, else the code page of Windows."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")
