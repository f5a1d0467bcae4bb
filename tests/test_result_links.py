"""Folders of results that a stranger may have sent: nothing is read or written through a link, nor is a pipe opened."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from sysid import array_file, files
from sysid.errors import OutputError
from sysid.folder_lock import FolderLock
from sysid.output_folder import output_folder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")

#: Every folder and file below an output folder that the program writes.
NAMES = (
    "result.json", "report.html", "parameters.csv", "posterior.nc", "SUCCESS", "error.log", ".lock",
    "figures/figure_5.svg", "models/unloaded/vehicle.json", "moving_forces/pass.csv", "predictions/peaks.csv",
    "profiles/c_6.csv", "stages/fit.npz", "stages/settings.json", "chain/segment-000000.npz", "chain/.lock",
    "campaigns/one/fleet.log", "campaigns/one/stages/fit.npz", "fleet.parquet/schema.json",
)  # fmt: skip


@pytest.fixture
def places(tmp_path: Path) -> tuple[Path, Path]:
    """An output folder as the user named it, and a folder of the user's that no link may lead to."""
    output, elsewhere = tmp_path / "output", tmp_path / "elsewhere"
    output.mkdir()
    elsewhere.mkdir()
    (elsewhere / "kept").write_text("mine")
    return output_folder(output), elsewhere


def contents(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): p.read_text() for p in folder.rglob("*") if p.is_file()}


def parts(name: str) -> list[str]:
    """The name and the folders in it: "a/b/c" gives a, a/b, a/b/c."""
    words = name.split("/")
    return ["/".join(words[: n + 1]) for n in range(len(words))]


LINKS = sorted({part for name in NAMES for part in parts(name)})


@pytest.mark.parametrize("link", LINKS)
def test_a_link_of_any_name_leads_nowhere(places: tuple[Path, Path], link: str) -> None:
    output, elsewhere = places
    (output / link).parent.mkdir(parents=True, exist_ok=True)
    is_file = link in NAMES
    (output / link).symlink_to(elsewhere / "kept" if is_file else elsewhere)
    for name in (n for n in NAMES if link in parts(n)):
        assert files.read_bytes(output / name) is None
        actions = [
            lambda n=name: files.write_text(output / n, "theirs"),
            lambda n=name: array_file.write(output / n, {}, {}),
            lambda n=name: FolderLock((output / n).parent).__enter__(),
        ]
        for action in actions[:2] if is_file and not name.endswith(".lock") else actions:
            if is_file and action is not actions[2]:
                # The link itself is replaced.
                action()
                assert not (output / link).is_symlink()
                (output / link).unlink()
                (output / link).symlink_to(elsewhere / "kept")
            else:
                with pytest.raises(OutputError, match=r"is a link|no plain file"):
                    action()
        if not is_file:
            with pytest.raises(OutputError, match="is a link"):
                files.remove(output / name)
    with pytest.raises((OutputError, OSError)), files.appended(output / link / ("" if is_file else "fleet.log")):
        pass
    files.remove_unfinished(output, depth=2)
    assert contents(elsewhere) == {"kept": "mine"}


def test_unfinished_files_are_removed_here_and_not_behind_links(places: tuple[Path, Path]) -> None:
    output, elsewhere = places
    (elsewhere / ".writing-1").write_text("")
    for folder in ("models", "models/unloaded", "models/unloaded/deep"):
        (output / folder).mkdir()
        (output / folder / ".writing-2").write_text("")
        (output / folder / "finished").write_text("")
    (output / "figures").symlink_to(elsewhere)
    files.remove_unfinished(output, depth=2)
    assert (elsewhere / ".writing-1").exists()
    left = {p.relative_to(output).as_posix() for p in output.rglob("*") if p.is_file()}
    assert left == {f"{f}/finished" for f in ("models", "models/unloaded", "models/unloaded/deep")} | {
        "models/unloaded/deep/.writing-2"
    }


def test_unfinished_files_are_looked_for_as_deep_as_asked_and_without_paths(
    places: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    output, _ = places
    looked_at: list[object] = []
    scan = os.scandir
    monkeypatch.setattr(os, "scandir", lambda place: (looked_at.append(place), scan(place))[1])
    for depth in range(5):
        deepest = output.joinpath(*"abcde"[:depth])
        deepest.mkdir(exist_ok=True)
        for above in (deepest, *deepest.parents)[: depth + 1]:
            (above / ".writing-3").write_text("")
    files.remove_unfinished(output, depth=3)
    # A path could lead elsewhere by now: folders are read that are open.
    assert [type(place) for place in looked_at] == [int] * 4
    assert [p.relative_to(output).as_posix() for p in output.rglob(".writing-*")] == ["a/b/c/d/.writing-3"]


def test_looking_makes_no_folder(places: tuple[Path, Path]) -> None:
    output, _ = places
    missing = output / "predictions" / "peaks.csv"
    assert files.read_bytes(missing) is None
    assert not files.is_plain(missing)
    assert files.read_json(missing) == {}
    files.remove(missing)
    files.remove_unfinished(missing.parent)
    assert list(output.iterdir()) == []


def test_the_output_folder_itself_may_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "output").symlink_to(tmp_path / "disk")
    output = output_folder(tmp_path / "output")
    files.write_text(output / "predictions" / "peaks.csv", "x")
    assert files.read_bytes(output / "predictions" / "peaks.csv") == b"x"
    assert (tmp_path / "disk" / "predictions" / "peaks.csv").is_file()


@pytest.mark.parametrize("special", ["fifo", "folder"])
def test_what_is_no_plain_file_is_not_opened(places: tuple[Path, Path], special: str) -> None:
    output, _ = places
    path = output / "result.json"
    os.mkfifo(path) if special == "fifo" else path.mkdir()
    assert files.read_bytes(path) is None
    with pytest.raises(OSError, match=r"no plain file|No such device|directory"), files.appended(path):
        pass


@pytest.mark.parametrize("mask", [0o077, 0o027, 0o022, 0o002])
def test_modes_follow_the_umask(tmp_path: Path, mask: int) -> None:
    script = (
        "import os, sys\nfrom pathlib import Path\nfrom sysid.files import appended, write_text\n"
        "os.umask(int(sys.argv[2]))\nfolder = Path(sys.argv[1])\n"
        "write_text(folder / 'predictions' / 'peaks.csv', '')\n"
        "with appended(folder / 'fleet.log'):\n    pass\n"
    )
    subprocess.run([sys.executable, "-c", script, str(tmp_path), str(mask)], check=True)
    for name, mode in (("predictions", 0o777), ("predictions/peaks.csv", 0o666), ("fleet.log", 0o666)):
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == mode & ~mask, name


def test_a_lock_that_is_a_pipe_does_not_keep_anybody_waiting(places: tuple[Path, Path]) -> None:
    output, _ = places
    os.mkfifo(output / ".lock")
    with pytest.raises(OutputError, match="no plain file"), FolderLock(output):
        pass


def test_nothing_in_the_package_writes_by_other_means() -> None:
    """Paths are opened for writing in these modules only; every other writes by `sysid.files`."""
    import re

    allowed = {
        "files.py": "the walker",
        "bounded_reader.py": "a pipe",
        "private_files.py": "folders of compiled code",
        "vehicle_model/native/build.py": "the same",
        "vehicle_model/native/header.py": "the same",
        "workflow/sources.py": "the same",
        "export/inference_data.py": "a temporary folder",
        "logs/formats/uff.py": "a temporary folder",
        "road/cloud_libraries.py": "a temporary folder",
        "fleet/sent_files.py": "private and temporary folders",
        "fleet/simulate.py": "campaigns of a new fleet",
        "fleet/index.py": "a temporary folder, then a folder that was looked at",
        "fleet/child.py": "removes a folder, which a link is not",
    }
    root = Path(files.__file__).parent
    writes = re.compile(
        r"\.(write_text|write_bytes|mkdir|touch|unlink|symlink_to|rmdir)\(|os\.(replace|rename|unlink|mkdir)\(|"
        r"shutil\.(?!which)|\bopen\([^)\n]*[\"']([wax]b?\+?|r\+b?|rb\+)[\"']"
    )
    found = {
        path.relative_to(root).as_posix()
        for path in root.rglob("*.py")
        if any(writes.search(line) for line in path.read_text(encoding="utf-8").splitlines())
    }
    assert found - allowed.keys() == set()
    assert writes.search('with path.open("ab") as log')
    assert not writes.search('path.open("rb")')
