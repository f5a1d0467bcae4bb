"""Names of channels: the form in which they are compared."""

from __future__ import annotations

import unicodedata


def normal_name(name: str) -> str:
    """The name with composed letters (Unicode NFC): some systems write an umlaut as one character, others as two."""
    return unicodedata.normalize("NFC", name)
