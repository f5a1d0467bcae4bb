"""The folder that is written to, as the user named it: checked before anything is computed."""

from __future__ import annotations

import os
import unicodedata
from pathlib import Path

from sysid import limits
from sysid.errors import CampaignError
from sysid.files import keep_inside

_UNSEEN = ("Cc", "Cs", "Zl", "Zp")  # control characters, halves of surrogate pairs, separators of lines


def output_folder(name: str | Path) -> Path:
    """The output folder named by `name`, which need not exist; from now on links below it are not followed.

    Parameters
    ----------
    name : as typed: ``Path("")`` is the current folder and cannot be told from ``Path(".")``, so give the text.

    Raises
    ------
    CampaignError
        If the name is empty or ``-``, holds control characters, is too long for a file system, or names a file.
    """
    text = os.fspath(name)
    if not text.strip():
        raise CampaignError("--output is empty; give the name of a folder, or '.' for the current one.")
    if text == "-":
        raise CampaignError("--output is '-', but results are several files; give the name of a folder.")
    if has_control_characters(text):
        raise CampaignError("--output contains control characters; give a name of letters, digits and signs.")
    path = Path(text)
    longest = max((part for part in path.parts), key=len, default="")
    if len(os.fsencode(longest)) > limits.NAME_BYTES or len(text) > limits.PATH_LENGTH:
        raise CampaignError(
            f"--output has a name of {max(len(longest), 1)} characters ('{longest[:40]}...'), more than a file system "
            "takes; give a shorter one."
        )
    try:
        # Also where a part of the path above is a file.
        blocked = next((p for p in (path, *path.parents) if p.exists() and not p.is_dir()), None)
    except OSError as error:
        raise CampaignError(f"--output cannot be used ({error.strerror}); choose another folder.") from None
    if blocked is not None:
        raise CampaignError(f"--output names a file, {blocked.name}; give a folder instead.")
    keep_inside(path)
    return path


def has_control_characters(name: str) -> bool:
    """Whether a name holds characters that no file name needs and that mislead who reads it in a message."""
    return any(unicodedata.category(c) in _UNSEEN for c in name)
