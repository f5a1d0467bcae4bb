"""Input files of a campaign: never outside its folder, and of a size that can be read."""

from __future__ import annotations

import difflib
import os
from pathlib import Path, PurePosixPath, PureWindowsPath

from sysid import limits
from sysid.errors import CampaignError, DataRejectedError
from sysid.logs.input_file import FileRefusedError, InputFile, read_file, read_file_inside
from sysid.output_folder import has_control_characters
from sysid.wording import finish, shorten


def campaign_file(path: str | Path) -> InputFile:
    """The campaign file, given its path or its folder.

    Raises
    ------
    CampaignError
        If there is no such file, or it is not a readable file of at most 2 MB.
    """
    text = os.fspath(path)
    if "\0" in text or len(text) > limits.PATH_LENGTH:
        raise CampaignError("The path of the campaign file is not a valid path; give a shorter one.")
    file = Path(text)
    try:
        if file.is_dir():
            file = file / "campaign.toml"
        return read_file(file, limits.CAMPAIGN_BYTES)
    except FileNotFoundError:
        raise CampaignError(f"There is no campaign file '{_tail(file)}'; {_near_sibling(file)}.") from None
    except FileRefusedError as error:
        raise CampaignError(f"The campaign file '{_tail(file)}' {_campaign_refused(error)}.") from None
    except (OSError, ValueError, RuntimeError) as error:
        raise CampaignError(f"The campaign file '{_tail(file)}' cannot be opened ({_reason(error)}).") from None


def _campaign_refused(error: FileRefusedError) -> str:
    if error.kind == "size":
        most = f"{limits.CAMPAIGN_BYTES / 1e6:.0f}"
        return f"has {error.size / 1e6:.0f} MB, a campaign file has at most {most}; is it a log"
    if error.kind == "changed":
        return "changed while it was read; start again when it has been saved"
    return "is not a file; give the path of a campaign.toml"


def input_file(folder: Path, name: str, key: str, limit_bytes: int) -> InputFile:
    """Read an input file named in the campaign file, which must lie inside the campaign folder.

    Parameters
    ----------
    folder : folder of the campaign file.
    name : relative name with forward slashes, as written in the campaign file.
    key : key path for messages.
    limit_bytes : largest size that will be read.

    Raises
    ------
    CampaignError
        If the name is absolute, leads outside the folder (also through a link), is too long, does not exist (the
        nearest existing name is suggested) or is not a file.
    DataRejectedError
        If the file is larger than the limit, or changed while it was read.
    """
    check_name(name, key)
    shown = f"{key} names '{shorten(name, 100)}'"
    try:
        return read_file_inside(folder, name, limit_bytes)
    except (FileNotFoundError, NotADirectoryError):
        raise CampaignError(finish(f"{shown}, which does not exist; {_near_input(folder, name)}")) from None
    except FileRefusedError as error:
        raise _refused(shown, error, limit_bytes) from None
    except (OSError, ValueError, RuntimeError) as error:
        raise CampaignError(f"{shown}, which cannot be opened ({_reason(error)}).") from None


def check_name(name: str, key: str) -> None:
    """Refuse a name of an input file that is no relative path inside the campaign folder; `key` is for messages.

    Raises
    ------
    CampaignError
        If the name is empty, absolute, too long, leads outside or holds control characters or backslashes.
    """
    shown = f"{key} names '{shorten(name, 100)}'"
    if "\\" in name:
        raise CampaignError(f"{shown}; write the path with forward slashes.")
    pure = PurePosixPath(name)
    if not name.strip() or has_control_characters(name):
        raise CampaignError(
            f"{shown}, which is empty or contains control characters; give the name of a file, with / between folders."
        )
    if pure.is_absolute() or PureWindowsPath(name).drive or name.startswith("~"):
        raise CampaignError(f"{shown}, an absolute path; file names are relative to the campaign file.")
    if ".." in pure.parts:
        raise CampaignError(f"{shown}, which leads outside the campaign folder; move the file into the folder.")
    if any(len(os.fsencode(p)) > limits.NAME_BYTES for p in pure.parts) or len(os.fsencode(name)) > limits.PATH_BYTES:
        raise CampaignError(f"{shown}, a name of {len(name)} characters; give a shorter one.")


def _refused(shown: str, error: FileRefusedError, limit_bytes: int) -> CampaignError | DataRejectedError:
    if error.kind == "size":
        return DataRejectedError(
            f"{shown}, a file of {error.size / 1e6:.0f} MB, at most {limit_bytes / 1e6:.0f} are read; "
            "cut it to the time of the test."
        )
    if error.kind == "changed":
        return DataRejectedError(f"{shown}, which changed while it was read; start again when it is complete.")
    reason = {
        "link": "a link that leads outside the campaign folder; copy the file into the folder",
        "folder": "which is a folder; give the name of a file in it",
    }.get(error.kind, "which is not a regular file; give the name of a file")
    return CampaignError(f"{shown}, {reason}.")


def relative_name(name: str) -> str:
    """Normal form of a relative file name (forward slashes, no `./`)."""
    return str(PurePosixPath(name))


def _tail(path: Path) -> str:
    return shorten(path, 120)


def _reason(error: BaseException) -> str:
    return shorten(getattr(error, "strerror", None) or type(error).__name__, 60).lower()


def _near_sibling(file: Path) -> str:
    try:
        names = sorted(p.name for p in file.parent.iterdir() if ".toml" in p.name) if file.parent.is_dir() else []
    except OSError:
        names = []
    # Editors that hide endings save 'campaign.toml' as 'campaign.toml.txt'.
    longer = next((n for n in names if n.lower().startswith(f"{file.name.lower()}.")), None)
    if longer is not None:
        return f"the folder has {shorten(longer)}: rename it to {shorten(file.name)}"
    names = [n for n in names if n.endswith(".toml")]
    return f"the folder has {', '.join(shorten(n) for n in names[:3])}" if names else "check the path"


def _near_input(folder: Path, name: str) -> str:
    nearby: list[str] = []
    for root, folders, files in os.walk(folder):
        folders[:] = sorted(f for f in folders if not f.startswith("."))[:100]
        nearby += [(Path(root) / f).relative_to(folder).as_posix() for f in sorted(files)]
        if len(nearby) > limits.LISTED_FILES:
            break
    # Folders and suffixes are alike for all files of a campaign: the name itself tells what is meant.
    by_stem = {PurePosixPath(n).stem: n for n in reversed(nearby[: limits.LISTED_FILES])}
    near = difflib.get_close_matches(PurePosixPath(relative_name(name)).stem, list(by_stem), n=1, cutoff=0.7)
    if near:
        return f"did you mean '{shorten(by_stem[near[0]], 100)}'"
    return "check the name, relative to the campaign file"
