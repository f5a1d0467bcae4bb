"""Input files of a campaign: never outside its folder, hashed, and of a size that can be read."""

from __future__ import annotations

import difflib
import hashlib
import os
import stat
from pathlib import Path, PurePosixPath, PureWindowsPath

from sysid.campaign.wording import finish, shorten
from sysid.errors import CampaignError, DataRejectedError

CAMPAIGN_BYTES = 5_000_000
LOG_BYTES = 500_000_000
SCAN_BYTES = 1_000_000_000
PROFILE_BYTES = 200_000_000
_NAME_BYTES = 255  # longest file name of common file systems
_LISTED_FILES = 5_000


def locate_campaign(path: str | Path) -> Path:
    """Path of the campaign file, given itself or its folder.

    Raises
    ------
    CampaignError
        If there is no such file, or it is not a readable file of at most 5 MB.
    """
    text = os.fspath(path)
    if "\0" in text or len(text) > 4096:
        raise CampaignError("The path of the campaign file is not a valid path; give a shorter one.")
    file = Path(text)
    try:
        if file.is_dir():
            file = file / "campaign.toml"
        status = file.stat()
    except FileNotFoundError:
        raise CampaignError(f"There is no campaign file '{_tail(file)}'; {_near_sibling(file)}.") from None
    except (OSError, ValueError, RuntimeError) as error:
        raise CampaignError(f"The campaign file '{_tail(file)}' cannot be opened ({_reason(error)}).") from None
    if not stat.S_ISREG(status.st_mode):
        raise CampaignError(f"The campaign file '{_tail(file)}' is not a file; give the path of a campaign.toml.")
    if status.st_size > CAMPAIGN_BYTES:
        raise CampaignError(
            f"The campaign file '{_tail(file)}' has {status.st_size / 1e6:.0f} MB, a campaign file has at most 5; "
            "is it a log?"
        )
    return file


def input_file(folder: Path, name: str, key: str, limit_bytes: int) -> Path:
    """Path of an input file named in the campaign file, checked to lie inside the campaign folder.

    Parameters
    ----------
    folder
        Folder of the campaign file.
    name
        Relative name with forward slashes, as written in the campaign file.
    key
        Key path for messages.
    limit_bytes
        Largest size that will be read.

    Raises
    ------
    CampaignError
        If the name is absolute, leads outside the folder (also through a link), is too long, does not exist (the
        nearest existing name is suggested) or is not a file.
    DataRejectedError
        If the file is larger than the limit.
    """
    shown = f"{key} names '{shorten(name, 100)}'"
    if "\\" in name:
        raise CampaignError(f"{shown}; write the path with forward slashes.")
    pure = PurePosixPath(name)
    if not name.strip() or any(ord(c) < 32 for c in name):
        raise CampaignError(f"{shown}, which is empty or contains control characters; give the name of a file.")
    if pure.is_absolute() or PureWindowsPath(name).drive or name.startswith("~"):
        raise CampaignError(f"{shown}, an absolute path; file names are relative to the campaign file.")
    if ".." in pure.parts:
        raise CampaignError(f"{shown}, which leads outside the campaign folder; move the file into the folder.")
    if any(len(os.fsencode(p)) > _NAME_BYTES for p in pure.parts) or len(os.fsencode(name)) > 1000:
        raise CampaignError(f"{shown}, a name of {len(name)} characters; give a shorter one.")
    path = folder / name
    try:
        resolved = path.resolve()
        if not resolved.is_relative_to(folder.resolve()):
            raise CampaignError(
                f"{shown}, a link that leads outside the campaign folder; copy the file into the folder."
            )
        status = resolved.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise CampaignError(finish(f"{shown}, which does not exist; {_near_input(folder, name)}")) from None
    except (OSError, ValueError, RuntimeError) as error:
        raise CampaignError(f"{shown}, which cannot be opened ({_reason(error)}).") from None
    if stat.S_ISDIR(status.st_mode):
        raise CampaignError(f"{shown}, which is a folder; give the name of a file in it.")
    if not stat.S_ISREG(status.st_mode):
        raise CampaignError(f"{shown}, which is not a regular file; give the name of a file.")
    if status.st_size > limit_bytes:
        raise DataRejectedError(
            f"{shown}, a file of {status.st_size / 1e6:.0f} MB, at most {limit_bytes / 1e6:.0f} are read; "
            "cut it to the time of the test."
        )
    return path


def relative_name(name: str) -> str:
    """Normal form of a relative file name (forward slashes, no `./`)."""
    return str(PurePosixPath(name))


def sha256(path: Path) -> str:
    """SHA-256 of a file as hexadecimal text.

    Raises
    ------
    CampaignError
        If the file cannot be read.
    """
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise CampaignError(f"The file '{_tail(path)}' cannot be read ({_reason(error)}).") from None


def read_bytes(path: Path) -> bytes:
    """Content of a file whose size has been checked.

    Raises
    ------
    CampaignError
        If the file cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise CampaignError(f"The file '{_tail(path)}' cannot be read ({_reason(error)}).") from None


def _tail(path: Path) -> str:
    return shorten(path, 120)


def _reason(error: BaseException) -> str:
    return shorten(getattr(error, "strerror", None) or type(error).__name__, 60).lower()


def _near_sibling(file: Path) -> str:
    try:
        names = (
            sorted(p.name for p in file.parent.iterdir() if p.suffix == ".toml")[:50] if file.parent.is_dir() else []
        )
    except OSError:
        names = []
    return f"the folder has {', '.join(shorten(n) for n in names[:3])}" if names else "check the path"


def _near_input(folder: Path, name: str) -> str:
    found: list[str] = []
    for root, folders, files in os.walk(folder):
        folders[:] = sorted(f for f in folders if not f.startswith("."))[:100]
        found += [(Path(root) / f).relative_to(folder).as_posix() for f in sorted(files)]
        if len(found) > _LISTED_FILES:
            break
    near = difflib.get_close_matches(relative_name(name), found[:_LISTED_FILES], n=1, cutoff=0.5)
    return f"did you mean '{shorten(near[0], 100)}'" if near else "check the name, relative to the campaign file"
