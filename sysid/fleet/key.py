"""Whether a calibration is still that of its inputs: one hash of files, options, version and program code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sysid.errors import CampaignError
from sysid.export.identity import content_sha256
from sysid.files import read_json
from sysid.workflow.sources import code_digest
from sysid.workflow.stages import STAGES
from sysid.workflow.versions import versions

#: Bytes of a file that are hashed at a time.
_BLOCK = 1 << 20
#: Options that decide when a calibration ends, not what its numbers are: a stored chain goes on when they change.
_ENDING = ("max_steps",)


def calibration_key(inputs: Mapping[str, str], choices: Mapping[str, Any]) -> str:
    """Hash of everything that the result of a calibration depends on.

    Parameters
    ----------
    inputs : SHA-256 of every input file by name.
    choices : options of the command line; None and False count as not typed.
    """
    content = {
        "inputs": dict(sorted(inputs.items())),
        "choices": typed_options(choices),
        "versions": versions(),
        "code": program_digest(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def chain_key(inputs: Mapping[str, str], choices: Mapping[str, Any]) -> str:
    """The same without the options that only say how long to sample."""
    return calibration_key(inputs, {k: v for k, v in choices.items() if k not in _ENDING})


def typed_options(choices: Mapping[str, Any]) -> dict[str, Any]:
    """The options that were typed, in a fixed order."""
    return {k: v for k, v in sorted(choices.items()) if v is not None and v is not False}


def program_digest() -> str:
    """Hash of the program code behind all stages."""
    return code_digest(sorted({name for stage in STAGES for name in stage.code}))


def file_digests(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """SHA-256 of files below a folder by name; empty for one that cannot be read."""
    return {name: _digest(folder / name) for name in names}


def folder_state(folder: Path) -> dict[str, str]:
    """What tells whether anything in a campaign folder has changed: size and time of every file, hash of TOML files.

    For campaigns that could not be read: which files they need is not known.
    """
    stamps: dict[str, str] = {}
    try:
        files = sorted(p for p in folder.rglob("*") if p.is_file())
        for path in files:
            status = path.stat()
            stamp = f"{status.st_size} bytes, {status.st_mtime_ns} ns"
            name = path.relative_to(folder).as_posix()
            stamps[name] = _digest(path) if path.suffix == ".toml" else stamp
    except OSError:
        return {}
    return stamps


def result_digest(path: Path) -> str:
    """SHA-256 of a ``result.json`` without the times in it.

    Raises CampaignError if the file is missing or damaged.
    """
    try:
        document = read_json(path)
        _ = document["timings"]
        return content_sha256(document)
    except (KeyError, RecursionError):
        raise CampaignError(f"{path.name} is missing or damaged; run the fleet again.") from None


def _digest(path: Path) -> str:
    digest = hashlib.sha256()
    try:
        # A pipe would wait for a writer.
        if not path.is_file():
            return ""
        with path.open("rb") as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
    except OSError:
        return ""
    return digest.hexdigest()
