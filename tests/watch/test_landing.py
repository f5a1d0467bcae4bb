"""Files that land while they are looked at: half of them, under new names, with a clock that was set back."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from sysid.watch.landing import SETTLED_S, Copies, GrowingFolder, Landing


class _Clock:
    """A clock that the test moves."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


class _Watched:
    def __init__(self, root: Path):
        self.source, self.output, self.clock = root / "in", root / "out", _Clock()
        self.source.mkdir()
        self.growing, self.copies = GrowingFolder(self.source, self.clock), Copies(self.output)

    def write(self, name: str, text: str, time_s: float = 2e9) -> None:
        path = self.source / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        os.utime(path, (time_s, time_s))

    def look(self, after_s: float = 2.0 * SETTLED_S) -> tuple[Landing, ...]:
        self.clock.now += after_s
        return self.copies.take(self.source, self.growing.look())

    def both(self) -> tuple[Landing, ...]:
        """Two looks: what is new is complete at the second."""
        return (*self.look(), *self.look())

    def copied(self) -> dict[str, str]:
        files = [p for p in self.copies.folder.rglob("*") if p.is_file()]
        return {p.relative_to(self.copies.folder).as_posix(): p.read_text() for p in files}


@pytest.fixture
def watched(tmp_path: Path) -> _Watched:
    return _Watched(tmp_path)


def test_a_file_that_grows_waits_until_it_is_complete(watched: _Watched) -> None:
    for text in ("a", "ab", "abc"):
        watched.write("runs/one.csv", text)
        assert watched.look() == ()
        assert watched.copied() == {}
    # Too early by the clock of this machine.
    assert watched.look(0.4 * SETTLED_S) == ()
    assert watched.look() == (Landing("runs/one.csv", "new"),)
    assert watched.copied() == {"runs/one.csv": "abc"}
    assert watched.look() == ()


def test_an_empty_file_is_not_complete(watched: _Watched) -> None:
    watched.write("one.csv", "")
    assert watched.both() == ()


def test_a_file_that_keeps_its_size_while_it_is_written_waits(watched: _Watched) -> None:
    """Some loggers reserve the whole file first: its time stamp tells."""
    watched.write("one.csv", "000", 2e9)
    watched.look()
    watched.write("one.csv", "120", 2e9 + 1.0)
    assert watched.look() == ()
    watched.write("one.csv", "123", 2e9 + 2.0)
    assert watched.look() == ()
    assert watched.look() == (Landing("one.csv", "new"),)
    assert watched.copied() == {"one.csv": "123"}


def test_a_renamed_file_is_known_by_its_content(watched: _Watched) -> None:
    watched.write("one.csv", "same")
    watched.both()
    (watched.source / "one.csv").rename(watched.source / "two.csv")
    assert watched.both() == (Landing("two.csv", "renamed", "one.csv"),)
    assert watched.copied() == {"two.csv": "same"}


def test_a_file_that_is_gone_and_another_one_are_no_renaming(watched: _Watched) -> None:
    watched.write("one.csv", "same", 2e9)
    watched.both()
    (watched.source / "one.csv").unlink()
    watched.write("two.csv", "else", 2e9 + 5.0)
    assert watched.both() == (Landing("one.csv", "gone"), Landing("two.csv", "new"))
    assert watched.copied() == {"two.csv": "else"}


def test_another_content_takes_the_place_of_the_first(watched: _Watched) -> None:
    watched.write("one.csv", "first")
    watched.both()
    watched.write("one.csv", "again", 2e9 + 60.0)
    assert watched.both() == (Landing("one.csv", "replaced"),)
    assert watched.copied() == {"one.csv": "again"}


@pytest.mark.parametrize(("later_s", "said"), [(-3600.0, True), (-30.0, False), (60.0, False)])
def test_a_clock_that_was_set_back_is_said(watched: _Watched, later_s: float, said: bool) -> None:
    watched.write("one.csv", "first", 2e9)
    watched.both()
    watched.write("two.csv", "second", 2e9 + later_s)
    (landing,) = watched.both()
    assert ("the clock of the logger was set back" in landing.remark) is said
    assert ("(2033-05-18 02:33 UTC)" in landing.remark) is said


def test_a_restart_knows_what_was_copied(watched: _Watched) -> None:
    watched.write("one.csv", "first")
    watched.both()
    again = Copies(watched.output)
    assert again.sha256 == watched.copies.sha256
    watched.copies = again
    watched.growing = GrowingFolder(watched.source, watched.clock)
    assert watched.both() == ()


def test_a_damaged_list_of_copies_is_made_anew(watched: _Watched) -> None:
    watched.write("one.csv", "first")
    watched.both()
    (watched.output / "files.json").write_text('{"one.csv": 3}')
    watched.copies = Copies(watched.output)
    assert watched.both() == (Landing("one.csv", "new"),)


def test_nothing_is_written_into_the_folder_of_the_logger(watched: _Watched) -> None:
    watched.write("one.csv", "first")
    before = sorted(p.name for p in watched.source.rglob("*"))
    watched.both()
    assert sorted(p.name for p in watched.source.rglob("*")) == before
    shutil.rmtree(watched.source)
    with pytest.raises(Exception, match="does not exist"):
        watched.look()
    assert watched.copied() == {"one.csv": "first"}
