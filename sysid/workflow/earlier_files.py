"""Files of an earlier report, export or command that are no results of the present campaign.

A pass that is no longer requested, or a load case that is gone, must not be read as a result of the present campaign.
What each of them wrote is kept in ``stages/written.json``; only plain files that it names, where reports and exports
write, are ever removed: a file that somebody put beside them stays.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from sysid.files import read_json, remove, write_text

_RECORD = Path("stages") / "written.json"
#: Where reports and exports write: folders below the output folder, and files in it.
_FOLDERS = ("figures", "models", "moving_forces", "predictions", "profiles")
_FILES = (
    "axle_load_spectra.csv", "axle_loads.csv", "covariance.json", "parameters.csv", "posterior.nc", "summary.pdf",
    "validation.csv",
)  # fmt: skip


def remove_earlier(folder: Path, ending: str, written: Iterable[Path]) -> list[Path]:
    """Remove what an ending once wrote into an output folder and has not written this time; return these files.

    Parameters
    ----------
    folder : the output folder.
    ending : name of the report or export, or of the stage whose command wrote files aside.
    written : the files that it has written this time.

    Raises
    ------
    OSError
        If a file cannot be removed, or the list cannot be written.
    """
    present = sorted({path.relative_to(folder).as_posix() for path in written})
    names = _earlier(folder, ending)
    gone = [path for name in names if name not in present and (path := _own_file(folder, name)) is not None]
    for path in gone:
        remove(path)
    _keep(folder, ending, present)
    return gone


def remember_more(folder: Path, kind: str, written: Iterable[Path]) -> None:
    """Add files that are no part of an export to those of their `kind` that :func:`remove_earlier` may remove.

    Raises
    ------
    OSError
        If the list cannot be written.
    """
    more = {path.relative_to(folder).as_posix() for path in written}
    _keep(folder, kind, sorted(more.union(_earlier(folder, kind))))


def _earlier(folder: Path, kind: str) -> list[str]:
    earlier = read_json(folder / _RECORD).get(kind)
    return [name for name in earlier if isinstance(name, str)] if isinstance(earlier, list) else []


def _keep(folder: Path, kind: str, names: list[str]) -> None:
    record = folder / _RECORD
    lists = read_json(record)
    if lists.get(kind, []) != names:
        write_text(record, json.dumps({**lists, kind: names}, indent=1))


def _own_file(folder: Path, name: str) -> Path | None:
    """The plain file of that name if reports or exports write there; a list may come from a stranger."""
    parts = PurePosixPath(name).parts
    if not parts or any(part in ("..", "/") or "\\" in part or ":" in part for part in parts):
        return None
    if parts[0] not in (_FOLDERS if len(parts) > 1 else _FILES):
        return None
    path = folder.joinpath(*parts)
    links = (folder.joinpath(*parts[:depth]).is_symlink() for depth in range(1, len(parts) + 1))
    try:
        return path if path.is_file() and not any(links) else None
    except (OSError, ValueError):
        # No name of a file: too long, or with a null byte.
        return None
