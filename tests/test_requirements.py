"""What is installed was tried: locked versions keep to the bounds, and lowest.txt holds the lower bounds themselves."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from tools.audit import weak

ROOT = Path(__file__).resolve().parents[1]
REQUIREMENTS = ROOT / "requirements"
LOCKS = ("run", "dev", "lowest")


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def locked(text: str) -> dict[str, set[Version]]:
    """Versions by name in a lock; several where they depend on Python or the system."""
    found: dict[str, set[Version]] = {}
    for block in re.split(r"\n(?=\S)", text.strip()):
        first, *hashes = block.split("\\\n")
        assert hashes, f"{first} has no hash"
        assert all(re.fullmatch(r"\s+--hash=sha256:[0-9a-f]{64}\s*", line) for line in hashes), first
        requirement = Requirement(first.strip())
        (exact,) = requirement.specifier
        assert exact.operator == "=="
        found.setdefault(plain(requirement.name), set()).add(Version(exact.version))
    return found


def lock(name: str) -> dict[str, set[Version]]:
    return locked((REQUIREMENTS / f"{name}.txt").read_text(encoding="utf-8"))


def declared(*extras: str) -> list[Requirement]:
    """Requirements of the package with extras, those of extras that name others among them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found: list[Requirement] = []
    waiting = [project["dependencies"], *(project["optional-dependencies"][e] for e in extras)]
    while waiting:
        for requirement in map(Requirement, waiting.pop()):
            if requirement.name == "truck-sysid":
                waiting += [project["optional-dependencies"][e] for e in requirement.extras]
            else:
                found.append(requirement)
    return found


def outside(requirements: list[Requirement], versions: dict[str, set[Version]]) -> list[str]:
    """Requirements that a lock does not meet."""
    return [
        str(r) for r in requirements if not all(v in r.specifier for v in versions.get(plain(r.name), {Version("0")}))
    ]


def untried(requirements: list[Requirement], versions: dict[str, set[Version]]) -> list[str]:
    """Requirements whose lower bound is not the version in a lock."""
    bounds = {r: [Version(s.version) for s in r.specifier if s.operator == ">="] for r in requirements}
    return [str(r) for r, lowest in bounds.items() if set(lowest) != versions.get(plain(r.name))]


@pytest.mark.parametrize(("name", "extra"), [("run", "run"), ("dev", "dev"), ("lowest", "test")])
def test_locked_versions_keep_to_the_bounds(name: str, extra: str) -> None:
    assert outside(declared(extra), lock(name)) == []
    assert outside([Requirement("numpy>=99"), Requirement("nothing>=1")], lock(name)) == ["numpy>=99", "nothing>=1"]


def test_every_lower_bound_is_a_version_that_is_tried() -> None:
    assert untried(declared("test"), lock("lowest")) == []
    assert untried([Requirement("click>=8.1")], lock("lowest")) == ["click>=8.1"]


def test_what_the_program_needs_has_an_upper_bound_where_versions_have_an_order() -> None:
    by_year = {"xarray"}
    assert [r.name for r in declared() if not any(s.operator == "<" for s in r.specifier)] == sorted(by_year)


def test_make_run_and_make_test_use_the_same_versions() -> None:
    run, dev = lock("run"), lock("dev")
    assert {name: dev[name] for name in run} == run


@pytest.mark.parametrize("name", LOCKS)
def test_locks_name_no_place_to_load_from(name: str) -> None:
    text = (REQUIREMENTS / f"{name}.txt").read_text(encoding="utf-8")
    assert not re.search(r"https?:|--(extra-)?index|--find-links|@ ", text)


def test_a_requirement_without_a_hash_is_seen() -> None:
    with pytest.raises(AssertionError, match="has no hash"):
        locked("numpy==2.4.6\n")


@pytest.mark.parametrize("name", LOCKS)
def test_no_locked_version_has_a_weakness_that_is_listed(name: str) -> None:
    known = (REQUIREMENTS / "weaknesses.json").read_text(encoding="utf-8")
    assert weak((REQUIREMENTS / f"{name}.txt").read_text(encoding="utf-8"), known) == []


def test_a_planted_weak_version_turns_the_audit_red(tmp_path: Path) -> None:
    text = (REQUIREMENTS / "run.txt").read_text(encoding="utf-8")
    planted = re.sub(r"^filelock==\S+", "filelock==3.16.1", text, flags=re.MULTILINE)
    for lock_text, code, said in ((text, 0, ""), (planted, 1, "filelock 3.16.1: CVE-2025-68146 (versions <3.20.1)")):
        (tmp_path / "lock.txt").write_text(lock_text, encoding="utf-8")
        command = [sys.executable, "-m", "tools.audit", str(tmp_path / "lock.txt")]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert said in done.stdout
    assert not weak("Filelock==3.20.3 \\\n", (REQUIREMENTS / "weaknesses.json").read_text(encoding="utf-8"))


def test_every_weakness_is_of_a_part() -> None:
    known = json.loads((REQUIREMENTS / "weaknesses.json").read_text(encoding="utf-8"))["weaknesses"]
    assert {plain(k["part"]) for k in known} <= lock("run").keys()


def test_lists_of_parts_and_licences_are_those_of_the_lock() -> None:
    run = lock("run")
    parts = json.loads((REQUIREMENTS / "parts.cdx.json").read_text(encoding="utf-8"))["components"]
    lines = (REQUIREMENTS / "licences.md").read_text(encoding="utf-8").splitlines()[2:]
    licences = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    listed = {plain(name): (Version(version), licence) for name, version, licence in licences}
    for name, version in [(p["name"], p["version"]) for p in parts] + [row[:2] for row in licences]:
        assert Version(version) in run[plain(name)]
    assert all(licence not in ("", "UNKNOWN") for _, licence in listed.values())
    assert {plain(p["name"]) for p in parts} - {"setuptools"} == listed.keys()
    assert {plain(r.name) for r in declared("run")} - {"setuptools"} <= listed.keys()
    # The licence of the package is permissive: so must be what nobody can leave out.
    assert [r.name for r in declared() if "GPL" in listed[plain(r.name)][1]] == []
