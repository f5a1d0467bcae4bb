"""How the compiled engine comes to be: built once, run only if it is this user's, done without where it cannot be."""

from __future__ import annotations

import ctypes
import os
import stat
from pathlib import Path
from types import SimpleNamespace

import pytest
from native_engine import needs_compiler

from sysid import private_files, runtime
from sysid.cli.invocation import configured
from sysid.errors import SysidError
from sysid.vehicle_model import engine
from sysid.vehicle_model.engines.reference import REFERENCE
from sysid.vehicle_model.native import build, kernel

on_posix = pytest.mark.skipif(os.name == "nt", reason="files have other owners and modes on Windows")


@pytest.fixture
def builds(monkeypatch, unregistered) -> list[build.Compiler]:
    """What was compiled since; a file of a few bytes stands for the library, any program for the compiler."""
    made: list[build.Compiler] = []

    def write(compiler: build.Compiler, file: Path, *flags: str) -> None:
        made.append(compiler)
        file.write_bytes(b"library")

    monkeypatch.setenv("CXX", "true")
    monkeypatch.setattr(build, "compile_engine", write)
    return made


def fake_compiler(folder: Path) -> Path:
    """A compiler that answers to --version and fails at everything else."""
    path = folder / "broken-c++"
    path.write_text('#!/bin/sh\n[ "$1" = --version ] && exit 0\necho "error: out of order" >&2\nexit 1\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@on_posix
def test_the_library_is_built_once_and_only_its_user_can_write_it(builds, unregistered):
    first = build.library()
    assert build.library() == first
    assert len(builds) == 1
    assert first.is_relative_to(unregistered / "cache")
    for path in (first, first.parent, first.parents[1], unregistered / "cache"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o700
    assert [p.name for p in first.parents[1].iterdir()] == [first.parent.name]


@on_posix
def test_each_number_of_coordinates_has_a_library_and_any_does_where_none_is_named(builds):
    long_truck = build.library(8)
    assert build.library() == long_truck
    assert len(builds) == 1
    rigid_truck = build.library(3)
    assert rigid_truck != long_truck
    assert len(builds) == 2
    assert build.library() in (rigid_truck, long_truck)
    assert (build.library(8), build.library(3)) == (long_truck, rigid_truck)
    assert len(builds) == 2


@on_posix
@pytest.mark.parametrize("what", ["content", "mode", "link", "no sha256", "folder mode", "folder link"])
def test_a_planted_library_is_not_run(builds, unregistered, what):
    """It stands where the library is looked for, with the right name; it is built anew instead."""
    found = build.library()
    planted = unregistered / "planted.so"
    planted.write_bytes(b"library")
    if what == "content":
        found.write_bytes(b"evil")
    elif what == "mode":
        found.chmod(0o722)
    elif what == "link":
        found.unlink()
        found.symlink_to(planted)
    elif what == "no sha256":
        found.with_name("engine.so.sha256").unlink()
    elif what == "folder mode":
        found.parent.chmod(0o777)
    else:
        found.parent.rename(unregistered / "elsewhere")
        found.parent.symlink_to(unregistered / "elsewhere")
    assert build.library() == found
    assert len(builds) == 2
    assert found.read_bytes() == b"library"
    private_files.check_private(found)


@on_posix
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("what", ["file", "sha256", "folder"])
def test_a_library_of_another_user_is_not_run(builds, what):
    found = build.library()
    os.chown({"file": found, "sha256": found.with_name("engine.so.sha256"), "folder": found.parent}[what], 12345, -1)
    assert build.library() == found
    assert len(builds) == 2
    private_files.check_private(found)


@on_posix
@pytest.mark.parametrize("level", ["cache", "cache/engine", "."])
def test_a_cache_folder_that_others_can_write_to_is_left_for_the_users_own(builds, unregistered, level):
    """The folder itself, the one inside it, and one above it."""
    shared = build.library()
    (unregistered / level).chmod(0o777)
    if level == ".":
        # Both stand below it: there is no place left.
        with (
            pytest.warns(runtime.CacheWarning, match="neither kept nor reused because .* can be written by others"),
            pytest.raises(build.BuildError, match=r"can be written by others \(mode 777\)"),
        ):
            build.library()
        return
    with pytest.warns(runtime.CacheWarning, match=r"can be written by others \(mode 777\); remove it"):
        own = build.library()
    assert own.is_relative_to(unregistered / "own")
    assert len(builds) == 2
    assert shared.exists()
    # Said once.
    assert build.library() == own


@on_posix
def test_a_folder_where_only_owners_rename_may_stand_above(builds, unregistered):
    unregistered.chmod(0o1777)
    assert build.library().is_relative_to(unregistered / "cache")


@on_posix
def test_a_group_of_ones_own_may_write_above_and_no_other(builds, unregistered, monkeypatch):
    """Where everybody has a private group new folders are often open to it."""
    unregistered.chmod(0o770)
    monkeypatch.setattr(private_files, "_own_group", lambda group, user: True)
    assert build.library().is_relative_to(unregistered / "cache")
    monkeypatch.setattr(private_files, "_own_group", lambda group, user: False)
    with pytest.warns(runtime.CacheWarning, match="mode 770"), pytest.raises(build.BuildError):
        build.library()


@on_posix
@pytest.mark.parametrize(("name", "members", "own"), [("anna", [], True), ("anna", ["ben"], False), ("lab", [], False)])
def test_a_group_is_ones_own_by_name_and_members(monkeypatch, name, members, own):
    import grp
    import pwd

    monkeypatch.setattr(pwd, "getpwuid", lambda user: SimpleNamespace(pw_gid=7, pw_name="anna"))
    monkeypatch.setattr(grp, "getgrgid", lambda group: SimpleNamespace(gr_name=name, gr_mem=members))
    assert private_files._own_group(7, 1000) is own
    assert not private_files._own_group(8, 1000)


@on_posix
def test_a_cache_folder_behind_a_link_is_that_folder(builds, unregistered):
    (unregistered / "real").mkdir(mode=0o700)
    (unregistered / "cache").symlink_to(unregistered / "real")
    assert build.library().is_relative_to(unregistered / "real")
    (unregistered / "real").chmod(0o777)
    with pytest.warns(runtime.CacheWarning):
        assert build.library().is_relative_to(unregistered / "own")


@on_posix
def test_functions_compiled_by_jax_are_kept_in_private_too(unregistered):
    folder = runtime.cache_folder()
    assert folder.is_relative_to(unregistered / "cache")
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o770)
    with pytest.warns(runtime.CacheWarning, match="mode 770"):
        assert runtime.cache_folder().is_relative_to(unregistered / "own")
    (unregistered / "own").chmod(0o777)
    with pytest.warns(runtime.CacheWarning, match="neither kept"), pytest.raises(private_files.NotPrivateError):
        runtime.cache_folder()


@on_posix
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away")
def test_functions_that_another_user_has_put_there_are_not_run(unregistered):
    """While the folder was open to all; it is not any more."""
    folder = runtime.cache_folder()
    (folder / "mine").write_bytes(b"")
    assert runtime.cache_folder() == folder
    (folder / "planted").write_bytes(b"")
    os.chown(folder / "planted", 12345, -1)
    with pytest.warns(runtime.CacheWarning, match="planted belongs to another user; remove it"):
        assert runtime.cache_folder().is_relative_to(unregistered / "own")


@on_posix
def test_two_builders_at_once_end_with_one_library(builds, monkeypatch):
    """The other one is done while this one compiles."""
    plain = build.compile_engine

    def overtaken(compiler: build.Compiler, file: Path, *flags: str) -> None:
        monkeypatch.setattr(build, "compile_engine", plain)
        build.library()
        plain(compiler, file, *flags)

    monkeypatch.setattr(build, "compile_engine", overtaken)
    found = build.library()
    assert len(builds) == 2
    assert [p.name for p in found.parents[1].iterdir()] == [found.parent.name]
    private_files.check_private(found)


@on_posix
def test_a_broken_compiler_means_the_reference_engine(monkeypatch, unregistered):
    monkeypatch.setenv("CXX", str(fake_compiler(unregistered)))
    monkeypatch.setenv("SYSID_ENGINE", "auto")
    assert engine.engine_of_process() is REFERENCE
    monkeypatch.setenv("SYSID_ENGINE", "native")
    with pytest.raises(SysidError, match="out of order"):
        engine.engine_name()


def test_no_compiler_means_the_reference_engine_and_is_said_once(monkeypatch, unregistered, caplog):
    monkeypatch.setenv("CXX", "no-such-compiler")
    monkeypatch.setenv("SYSID_ENGINE", "auto")
    assert engine.engine_name() == engine.engine_name() == "reference"
    (said,) = caplog.messages
    assert "no C++ compiler was found" in said
    assert "apt install g++" in said


def test_the_command_line_says_that_the_native_engine_is_missing(monkeypatch, unregistered):
    monkeypatch.setenv("CXX", "no-such-compiler")
    monkeypatch.setenv("SYSID_ENGINE", "auto")
    said: list[str] = []
    for _ in range(2):  # a second command in one process does not say it twice
        configured(said.append)
    engine.engine_of_process()
    assert len([s for s in said if "fifteen times as long" in s]) == 1


@needs_compiler
def test_an_unwritable_cache_folder_means_the_reference_engine(monkeypatch, unregistered):
    (unregistered / "cache").write_text("a file where the folder should be")
    monkeypatch.setenv("SYSID_ENGINE", "auto")
    assert engine.engine_name() == "reference"


@pytest.mark.parametrize("name", ["reference", "jax"])
def test_the_reference_engine_on_request(monkeypatch, name):
    monkeypatch.setenv("SYSID_ENGINE", name)
    assert engine.engine_of_process() is REFERENCE


def test_an_unknown_engine_is_refused(monkeypatch):
    monkeypatch.setenv("SYSID_ENGINE", "fortran")
    with pytest.raises(SysidError, match="auto, native or reference"):
        engine.engine_name()


@needs_compiler
def test_it_compiles_without_a_warning(tmp_path):
    """With the flags of the product; the library then says with which description it was compiled."""
    compiler = build.find_compiler()
    assert compiler is not None
    flags = ("-Werror", "-DSYSID_COORDINATES=4")
    build.compile_engine(compiler, tmp_path / "engine.so", *flags)
    loaded = ctypes.CDLL(str(tmp_path / "engine.so"))
    kernel.check_fingerprint(loaded)


@needs_compiler
@pytest.mark.parametrize(
    ("source", "message"),
    [
        ('extern "C" const char* sysid_fingerprint() { return "0123456789abcdef"; }', "takes other arrays"),
        ('extern "C" int nothing() { return 0; }', "does not say which arrays"),
    ],
    ids=["other", "silent"],
)
def test_a_library_of_another_description_is_refused(tmp_path, source, message):
    file = tmp_path / "other.cpp"
    file.write_text(source)
    compiler = build.find_compiler()
    assert compiler is not None
    build._run([*compiler, "-shared", "-fPIC", str(file), "-o", str(tmp_path / "other.so")])
    with pytest.raises(build.BuildError, match=message):
        kernel.check_fingerprint(ctypes.CDLL(str(tmp_path / "other.so")))
