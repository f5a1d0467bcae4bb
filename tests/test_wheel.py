"""The wheel: the same bytes whenever and wherever it is built, with its parts and their licences inside."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = ("pyproject.toml", "README.md", "LICENSE")
LISTS = ("LICENSE", "requirements/licences.md", "requirements/parts.cdx.json")


def built(place: Path, seconds: int) -> Path:
    """A wheel of a copy of the sources, whose files are as old as the copy."""
    source = place / "source"
    ignored = shutil.ignore_patterns("__pycache__", "*.so")
    for folder in ("sysid", "requirements"):
        shutil.copytree(ROOT / folder, source / folder, ignore=ignored, copy_function=shutil.copyfile)
    for name in FILES:
        shutil.copyfile(ROOT / name, source / name)
    words = ["-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-build-isolation"]
    environment = os.environ | {"SOURCE_DATE_EPOCH": str(seconds)}
    subprocess.run([sys.executable, *words, "--wheel-dir", str(place), str(source)], check=True, env=environment)
    (wheel,) = place.glob("*.whl")
    return wheel


def test_a_wheel_is_the_same_twice_and_carries_its_lists(tmp_path: Path) -> None:
    wheels = [built(tmp_path / name, seconds) for name, seconds in (("a", 1_700_000_000), ("deep/b", 1_700_000_000))]
    hashes = {hashlib.sha256(wheel.read_bytes()).hexdigest() for wheel in wheels}
    assert len(hashes) == 1
    other = built(tmp_path / "c", 1_600_000_000)
    assert hashlib.sha256(other.read_bytes()).hexdigest() not in hashes
    with zipfile.ZipFile(wheels[0]) as archive:
        (about,) = {name.split("/")[0] for name in archive.namelist() if ".dist-info/" in name}
        for name in LISTS:
            assert archive.read(f"{about}/licenses/{name}") == (ROOT / name).read_bytes()
