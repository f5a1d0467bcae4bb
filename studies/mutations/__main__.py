"""Command line of the study of mutations.

    python -m studies.mutations [--rooms NAME ...] [--count N] [--seed SEED] [--document FILE]

draws changes of cosmic-ray (https://cosmic-ray.readthedocs.io) in the rooms below, each in a copy of the package, and
runs the tests of the room.  Prints the changes that no test saw and a table and, if asked, writes the table into FILE.
Tests run in children of a process that has loaded pytest and the libraries and nothing of the package.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from difflib import unified_diff
from pathlib import Path
from typing import Any

import numpy as np

from studies.documents import write_between_marks

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 300.0
#: Files by room, and the tests that know them.
ROOMS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "files": (("files.py",), ("tests/test_result_links.py", "tests/export/test_tables.py")),
    "array_file": (("array_file.py",), ("tests/workflow/test_store.py", "tests/test_result_links.py")),
    "private_files": (("private_files.py",), ("tests/vehicle_model/test_native_library.py",)),
    "campaign/units": (("campaign/units.py",), ("tests/campaign/test_units.py",)),
    "sdof/equations": (("sdof/equations.py",), ("tests/sdof/test_sdof_equations.py",)),
    "fleet": (
        ("fleet/quadratic_forms.py", "fleet/loads.py", "fleet/changes.py"),
        ("tests/fleet/test_quadratic_forms.py", "tests/fleet/test_loads.py", "tests/fleet/test_fleet_results.py"),
    ),
    "estimation algebra": (
        ("estimation/uncertainty/normal_equations.py",),
        ("tests/estimation/test_normal_equations.py",),
    ),
}  # fmt: skip
#: Frozen classes are so by their decorator, which no test needs to thaw; the sum of flags is what joins them.
_LEFT_OUT = ("core/RemoveDecorator", "core/ReplaceBinaryOperator_BitOr_Add", "core/ReplaceBinaryOperator_BitOr_BitXor")


def mutants(file: Path) -> Iterator[tuple[str, int, str]]:
    """Kind, number and text of every change of a file."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator, operator_names

    source = file.read_text(encoding="utf-8")
    known = behaviour(source)
    for name in sorted(operator_names()):
        if name in _LEFT_OUT:
            continue
        operator = get_operator(name)
        for number in range(1000):
            try:
                text = mutate_code(source, operator(), number)
            except TypeError:
                # It asks for arguments.
                break
            if text is None:
                break
            try:
                same = behaviour(text) == known
            except SyntaxError:
                # Some changes are no programs: "a & not b".
                continue
            if not same:
                yield name, number, text


def behaviour(text: str) -> str:
    """A program without what is not run: types of arguments, results and members."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.arg | ast.AnnAssign):
            node.annotation = ast.Constant(None)
        if isinstance(node, ast.FunctionDef):
            node.returns = None
    return ast.dump(tree)


def drawn(room: str, count: int, seed: int) -> list[dict[str, Any]]:
    """Some of all changes of a room, without repetition of a text."""
    found: dict[str, dict[str, Any]] = {}
    for name in ROOMS[room][0]:
        for kind, number, text in mutants(ROOT / "sysid" / name):
            found.setdefault(text, {"room": room, "file": name, "kind": kind, "number": number, "text": text})
    some = list(found.values())
    at = np.random.default_rng(seed).permutation(len(some))[:count]
    return [some[i] | {"of": len(some)} for i in sorted(at)]


def survives(mutant: dict[str, Any]) -> bool:
    """Whether all tests of its room pass on a copy of the package with the change."""
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place)
        shutil.copytree(ROOT / "sysid", copy / "sysid", ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("tests", "studies", "examples", "data", "docs", "pyproject.toml", "README.md", "calibrate.py"):
            (copy / name).symlink_to(ROOT / name)
        (copy / "sysid" / mutant["file"]).write_text(mutant["text"], encoding="utf-8")
        child = os.fork()
        if child == 0:
            _test(copy, ROOMS[mutant["room"]][1])
        begin = time.monotonic()
        while time.monotonic() - begin < LIMIT_S:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                return os.waitstatus_to_exitcode(status) == 0
            time.sleep(0.05)
        os.kill(child, 9)
        os.waitpid(child, 0)
        return False


def _test(copy: Path, tests: tuple[str, ...]) -> None:
    code = 1
    try:
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)
        os.dup2(silence, 2)
        sys.path[:] = [str(copy), *(p for p in sys.path if Path(p or ".").resolve() != ROOT)]
        os.environ["PYTHONPATH"] = str(copy)
        os.chdir(copy)
        for name in [n for n in sys.modules if n.split(".")[0] in ("sysid", "studies")]:
            del sys.modules[name]
        import pytest

        arguments = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--rootdir", str(copy), "--import-mode=importlib"]
        code = int(pytest.main([*arguments, *tests]))
    finally:
        os._exit(code)


def difference(mutant: dict[str, Any]) -> str:
    """The lines that a change touches."""
    source = (ROOT / "sysid" / mutant["file"]).read_text(encoding="utf-8")
    lines = unified_diff(source.splitlines(), mutant["text"].splitlines(), n=0, lineterm="")
    return "\n".join(line for line in lines if not line.startswith(("---", "+++")))


def table(records: list[dict[str, Any]], page: str = "") -> str:
    """Score by room; a room that was not tried now keeps its line of the page."""
    place = page.partition("<!-- mutations: begin -->")[2].partition("<!-- mutations: end -->")[0]
    earlier = {line.split(" | ")[0].strip("|` "): line for line in place.splitlines() if line.startswith("| `")}
    lines = ["| room | changes | tried | seen by a test | score |", "|---|---:|---:|---:|---:|"]
    for room in ROOMS:
        some = [r for r in records if r["room"] == room]
        if not some:
            lines += [earlier[room]] if room in earlier else []
            continue
        seen = sum(not r["survives"] for r in some)
        lines.append(f"| `{room}` | {some[0]['of']:,} | {len(some)} | {seen} | {100.0 * seen / len(some):.0f} % |")
    return "\n".join(lines)


def main() -> None:
    """Try some changes of every room and show what survives."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/mutations"))
    parser.add_argument("--rooms", nargs="*", default=list(ROOMS), choices=list(ROOMS))
    parser.add_argument("--count", type=int, default=30, help="changes of a room")
    parser.add_argument("--seed", type=int, default=5501)
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    file = options.output / "records.jsonl"
    for room in options.rooms:
        untouched = {"room": room, "file": ROOMS[room][0][0], "text": (ROOT / "sysid" / ROOMS[room][0][0]).read_text()}
        if not survives(untouched):
            raise SystemExit(f"The tests of {room} do not pass on the package as it is.")
        for mutant in drawn(room, options.count, options.seed):
            record = {**mutant, "survives": survives(mutant), "change": difference(mutant)}
            del record["text"]
            if record["survives"]:
                sys.stdout.write(f"{mutant['file']}, {mutant['kind']}:\n{record['change']}\n")
                sys.stdout.flush()
            with file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(record) + "\n")
    records = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    page = "" if options.document is None else options.document.read_text(encoding="utf-8")
    sys.stdout.write(table(records, page) + "\n")
    if options.document is not None:
        write_between_marks(options.document, "mutations", table(records, page))


if __name__ == "__main__":
    main()
