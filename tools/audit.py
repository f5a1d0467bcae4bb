"""Known weaknesses of locked versions, without a network: ``python -m tools.audit requirements/run.txt ...``.

Ends with 1 if a lock has one. The list is requirements/weaknesses.json.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

from packaging.specifiers import SpecifierSet
from packaging.version import Version

WEAKNESSES = Path(__file__).resolve().parents[1] / "requirements" / "weaknesses.json"
_LOCKED = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)", re.MULTILINE)


def plain(name: str) -> str:
    """Name of a package as indices compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def weak(lock: str, weaknesses: str) -> list[str]:
    """A line for every weakness of a version in the text of a lock, from the text of the list."""
    found = []
    versions = [(plain(name), version) for name, version in _LOCKED.findall(lock)]
    for known in json.loads(weaknesses)["weaknesses"]:
        affected = SpecifierSet(known["versions"], prereleases=True)
        found += [
            f"{name} {version}: {known['name']} (versions {known['versions']})"
            for name, version in versions
            if name == plain(known["part"]) and Version(version) in affected
        ]
    return found


def main() -> None:
    """Look at the locks that are named."""
    known = WEAKNESSES.read_text(encoding="utf-8")
    found = [f"{file}: {line}" for file in sys.argv[1:] for line in weak(Path(file).read_text(encoding="utf-8"), known)]
    sys.stdout.write("".join(f"{line}\n" for line in found))
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
