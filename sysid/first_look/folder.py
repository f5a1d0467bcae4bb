"""What lies in the folder of a logger: logs, scans and other files, told apart by a look at their first lines."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sysid import limits
from sysid.errors import CampaignError, DataRejectedError
from sysid.first_look.text_heads import TextHead, text_head
from sysid.logs.input_file import FileRefusedError, InputFile, read_file_inside
from sysid.logs.registry import format_of
from sysid.output_folder import has_control_characters
from sysid.wording import shorten

What = Literal["log", "scan", "profile", "other"]

#: Suffixes of text that may be a log or a scan; other files without the mark of a format are not opened as text.
_TEXT = frozenset((".csv", ".txt", ".tsv", ".asc", ".xyz", ".pts", ".dat", ".prn", ".xls", ""))
_SCANS = {b"ply": "a PLY cloud", b"LASF": "a LAS cloud"}
#: Suffixes of files that nobody takes for a measurement.
_NEVER = frozenset(
    (".toml", ".md", ".pdf", ".png", ".jpg", ".jpeg", ".svg", ".html", ".py", ".json", ".zip", ".doc", ".docx", ".pptx",
     ".mp4", ".mov", ".avi", ".log", ".ini", ".xml", ".yaml", ".yml", ".ipynb")
)  # fmt: skip


@dataclass(frozen=True)
class FolderFile:
    """One file: its name relative to the folder, content, and what it is; `head` of a text."""

    name: str
    content: InputFile
    what: What
    title: str
    head: TextHead | None = None


def names_in(folder: Path) -> tuple[list[str], list[str]]:
    """Relative names (forward slashes) of the files below a folder, sorted; hidden ones are left out.

    Returns
    -------
    names, messages
        One sentence about each name that cannot be used, and each link to a folder: links are not followed.

    Raises
    ------
    CampaignError
        If it is no folder, is empty, or holds more files or bytes than a campaign has.
    """
    names, messages = names_so_far(folder)
    if not names and not messages:
        raise CampaignError(f"{shorten(folder, 100)} holds no files that could be logs; give the folder with the logs.")
    return names, messages


def names_so_far(folder: Path) -> tuple[list[str], list[str]]:
    """As :func:`names_in`, of a folder that may be empty still.

    Raises
    ------
    CampaignError
        If it is no folder, or holds more files or bytes than a campaign has.
    """
    label = shorten(folder, 100)
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise CampaignError(f"{label} {what}, expected the folder with the logs; give that folder.")
    names: list[str] = []
    messages: list[str] = []
    size = 0
    for root, folders, files in os.walk(folder):
        if Path(root) != folder and (Path(root) / "stages" / "timings.json").is_file():
            # Results of an earlier calibration.
            folders[:] = []
            continue
        seen = [Path(root) / f for f in sorted(folders) if not f.startswith(".")]
        refused = {path.name: why for path in seen if (why := _refusal(path, folder))}
        messages += refused.values()
        folders[:] = [path.name for path in seen if path.name not in refused]
        for name in sorted(files):
            path = Path(root) / name
            if name.startswith(".") or path.suffix.lower() in _NEVER:
                continue
            why = _refusal(path, folder)
            if why is not None:
                messages.append(why)
                continue
            names.append(path.relative_to(folder).as_posix())
            try:
                size += path.stat().st_size if path.is_file() else 0
            except FileNotFoundError:
                # Renamed or removed meanwhile.
                names.pop()
                continue
            if len(names) > limits.FIRST_LOOK_FILES:
                raise CampaignError(
                    f"{label} holds more than {limits.FIRST_LOOK_FILES} files; copy logs and scans of one campaign "
                    "into a folder of their own."
                )
    if size > limits.INPUT_BYTES:
        raise CampaignError(
            f"{label} holds {size / 1e9:.1f} GB, at most {limits.INPUT_BYTES / 1e9:.0f} are read; copy logs and scans "
            "of one campaign into a folder of their own."
        )
    return sorted(names), messages


def _refusal(path: Path, folder: Path) -> str | None:
    """Why a file or a folder below `folder` is left out for its name, or as a link to a folder."""
    name = path.relative_to(folder).as_posix()
    try:
        name.encode()
    except UnicodeEncodeError:
        shown = shorten(os.fsencode(name).decode("utf-8", "backslashreplace"), 100)
        return f"{shown} has a name that is no UTF-8 and is left out; rename it."
    if has_control_characters(name):
        return f"{shorten(name, 100)} has control characters in its name and is left out; rename it."
    if path.is_symlink() and path.is_dir():
        return (
            f"{shorten(name, 100)} is a link to a folder and is not followed: a campaign reads no files outside its "
            "folder; copy the logs there."
        )
    return None


def opened(folder: Path, name: str) -> FolderFile | None:
    """One file with what it is; None where neither content nor suffix looks like a measurement.

    Raises
    ------
    DataRejectedError
        If the file cannot be read; the sentence begins with its name.
    """
    label = shorten(name, 100)
    try:
        content = read_file_inside(folder, name, limits.LOG_BYTES)
    except FileRefusedError as error:
        reason = {
            "size": f"has {error.size / 1e6:.0f} MB, at most {limits.LOG_BYTES / 1e6:.0f} are read",
            "link": "is a link that leads out of the folder",
            "changed": "changed while it was read",
        }.get(error.kind, "is no regular file")
        raise DataRejectedError(f"{label} {reason}; it is left out.") from None
    except (OSError, ValueError) as error:
        reason = str(getattr(error, "strerror", None) or "no valid name").lower()
        raise DataRejectedError(f"{label} cannot be opened ({reason}); it is left out.") from None
    for mark, title in _SCANS.items():
        if content.data.startswith(mark):
            return FolderFile(name, content, "scan", title)
    known = format_of(content)
    if known.name != "csv":
        return FolderFile(name, content, "log", known.title)
    if content.suffix.lower() not in _TEXT:
        return None
    head = text_head(content.data)
    if head is None and content.suffix.lower() == ".xls":
        raise DataRejectedError(f"{label} is a text without a table of numbers; export it as CSV.")
    if head is None:
        return FolderFile(name, content, "other", "a text without a table of numbers")
    if head.is_profile:
        return FolderFile(name, content, "profile", "heights along the road")
    if head.is_cloud:
        return FolderFile(name, content, "scan", "a text cloud")
    return FolderFile(name, content, "log", known.title, head)
