"""`files.json`: which result every exported file is from, and its hash; also for formats without a place for that."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from sysid.export.identity import Identity
from sysid.files import is_plain, read_bytes, read_json, write_text

FILE_LIST = "files.json"
#: A number up whenever a key changes its meaning or goes; new keys leave it.
SCHEMA_VERSION = 1


def remember_files(folder: Path, written: Iterable[Path], identity: Identity) -> None:
    """Enter files below an output folder into its list: run, date, hashes of inputs and result, SHA-256 of the file.

    Files of which the list knows, and that are there no longer, go from it; other entries stay.

    Parameters
    ----------
    written : the files, complete.
    identity : of the result that they are from.
    """
    known = read_json(folder / FILE_LIST).get("files")
    files = {name: entry for name, entry in known.items() if _there(folder, name)} if isinstance(known, dict) else {}
    for path in written:
        content = read_bytes(path)
        if content is not None:
            about = {
                "run": identity.run,
                "date": identity.date or None,
                "inputs_sha256": identity.inputs_sha256,
                "result_sha256": identity.result_sha256,
            }
            files[path.relative_to(folder).as_posix()] = {"sha256": hashlib.sha256(content).hexdigest(), **about}
    document = {"schema": SCHEMA_VERSION, "files": dict(sorted(files.items()))}
    write_text(folder / FILE_LIST, json.dumps(document, indent=1, ensure_ascii=False) + "\n")


def _there(folder: Path, name: str) -> bool:
    """Whether a list, which may come from a stranger, names a file below the folder that is there."""
    parts = Path(name).parts
    return bool(parts) and ".." not in parts and not Path(name).is_absolute() and is_plain(folder / name)
