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


def names_in(folder: Path) -> list[str]:
    """Relative names (forward slashes) of the files below a folder, sorted; hidden ones are left out.

    Raises
    ------
    CampaignError
        If it is no folder, is empty, or holds more files or bytes than a campaign has.
    """
    label = shorten(folder, 100)
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise CampaignError(f"{label} {what}, expected the folder with the logs; give that folder.")
    names: list[str] = []
    size = 0
    for root, folders, files in os.walk(folder):
        if Path(root) != folder and (Path(root) / "stages" / "timings.json").is_file():
            # Results of an earlier calibration.
            folders[:] = []
            continue
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        for name in sorted(files):
            path = Path(root) / name
            if name.startswith(".") or path.suffix.lower() in _NEVER or has_control_characters(name):
                continue
            names.append(path.relative_to(folder).as_posix())
            size += path.stat().st_size if path.is_file() else 0
            if len(names) > limits.FIRST_LOOK_FILES:
                raise CampaignError(
                    f"{label} holds more than {limits.FIRST_LOOK_FILES} files; copy logs and scans of one campaign "
                    "into a folder of their own."
                )
    if not names:
        raise CampaignError(f"{label} holds no files that could be logs; give the folder with the logs.")
    if size > limits.INPUT_BYTES:
        raise CampaignError(
            f"{label} holds {size / 1e9:.1f} GB, at most {limits.INPUT_BYTES / 1e9:.0f} are read; copy logs and scans "
            "of one campaign into a folder of their own."
        )
    return sorted(names)


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
