"""The engine that a wheel carries: which build is taken, and when none is."""

from __future__ import annotations

import hashlib
import json
import os
import stat
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from native_engine import needs_compiler

from sysid import private_files
from sysid.vehicle_model import engine
from sysid.vehicle_model.native import build, kernel, prebuilt, processor

on_posix = pytest.mark.skipif(os.name == "nt", reason="files have other owners and modes on Windows")
as_root = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away")

#: Flags as Linux gives them for Intel processors: Haswell (2013), Skylake-SP (2017), Ivy Bridge (2012).
HASWELL = (
    "fpu vme de pse tsc msr pae mce cx8 apic sep mtrr pge mca cmov pat pse36 clflush mmx fxsr sse sse2 ht syscall nx "
    "pdpe1gb rdtscp lm constant_tsc nopl xtopology pni pclmulqdq ssse3 fma cx16 pcid sse4_1 sse4_2 x2apic movbe popcnt "
    "aes xsave avx f16c rdrand hypervisor lahf_lm abm fsgsbase bmi1 avx2 smep bmi2 erms invpcid xsaveopt"
)
SKYLAKE = f"{HASWELL} avx512f avx512dq rdseed adx clflushopt clwb avx512cd avx512bw avx512vl xsavec xgetbv1"
IVY_BRIDGE = " ".join(f for f in HASWELL.split() if f not in ("fma", "movbe", "abm", "bmi1", "avx2", "bmi2"))


def cpuinfo(*flags: str) -> str:
    """The text of Linux for cores with these flags."""
    return "\n".join(f"processor\t: {k}\nmodel name\t: Test\nflags\t\t: {f}\nbugs\t\t:\n" for k, f in enumerate(flags))


@pytest.fixture
def cores(monkeypatch, tmp_path):
    """Say what the processor of this machine can do."""

    def put(*flags: str) -> None:
        file = tmp_path / "cpuinfo"
        file.write_text(cpuinfo(*flags))
        monkeypatch.setattr(processor, "_CPUINFO", file)

    return put


@pytest.fixture
def packed(monkeypatch, tmp_path):
    """A folder of builds as a wheel brings it; some bytes stand for a library."""
    folder = tmp_path / "package" / "prebuilt"
    folder.mkdir(parents=True, mode=0o755)
    monkeypatch.setattr(prebuilt, "FOLDER", folder)

    def put(contents: dict[str, bytes], **changes: object) -> Path:
        hashes = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
        for name, content in contents.items():
            (folder / f"{name}.so").write_bytes(content)
        listed = {"sources": build.source_digest(), "builds": hashes} | changes
        (folder / prebuilt.LIST).write_text(json.dumps(listed))
        for file in folder.iterdir():
            file.chmod(0o644)
        return folder

    return put


BOTH = {"x86-64-v3": b"three", "x86-64-v4": b"four"}


@pytest.mark.parametrize(
    ("flags", "builds", "chosen"),
    [
        ([SKYLAKE], BOTH, "x86-64-v4"),
        ([SKYLAKE], {"x86-64-v3": b"three"}, "x86-64-v3"),
        ([HASWELL, HASWELL], BOTH, "x86-64-v3"),
        # One core of two is slower: a thread may come to either.
        ([SKYLAKE, HASWELL], BOTH, "x86-64-v3"),
        ([SKYLAKE.replace(" avx512vl", "")], BOTH, "x86-64-v3"),
        ([HASWELL], {"generic": b"any"}, "generic"),
        ([IVY_BRIDGE], BOTH, None),
        ([HASWELL.replace(" fma", "")], BOTH, None),
        ([HASWELL], {"x86-64-v4": b"four"}, None),
        ([], BOTH, None),
    ],
)
def test_the_fastest_build_that_the_processor_runs_is_taken(cores, packed, flags, builds, chosen):
    cores(*flags)
    folder = packed(builds)
    if chosen is None:
        with pytest.raises(build.BuildError, match="needs a processor with AVX2"):
            prebuilt.library()
    else:
        assert prebuilt.library() == (chosen, folder / f"{chosen}.so")


def test_levels_are_those_of_the_compiler(tmp_path):
    """GCC names the instruction sets of a level by macros; LAHF, CMPXCHG16B and XSAVE have other names or none."""
    compiler = build.find_compiler()
    if compiler is None or prebuilt.processor.platform.machine() != "x86_64":
        pytest.skip("needs a compiler for x86-64")
    names = {"pni": "SSE3", "abm": "LZCNT", "bmi1": "BMI", "lahf_lm": None, "cx16": None, "xsave": "XSAVE"}
    (tmp_path / "empty.cpp").write_text("")
    for level in ("x86-64-v3", "x86-64-v4"):
        said = build._run([*compiler, f"-march={level}", "-dM", "-E", str(tmp_path / "empty.cpp")]).stdout
        macros = {line.split()[1].strip("_") for line in said.splitlines()}
        wanted = {names.get(flag, flag.upper()) for flag in prebuilt.NEEDS[level]} - {None}
        assert wanted - {"XSAVE"} <= macros
        assert {m for m in macros if m.startswith("AVX512")} == {w for w in wanted if w.startswith("AVX512")}


def test_a_checkout_has_none(monkeypatch, tmp_path):
    monkeypatch.setattr(prebuilt, "FOLDER", tmp_path / "prebuilt")
    with pytest.raises(build.BuildError, match="this installation carries no prebuilt engine"):
        prebuilt.library()


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda folder: (folder / "x86-64-v3.so").write_bytes(b"tree"), "not the file that was packed; install"),
        (lambda folder: (folder / "x86-64-v3.so").unlink(), "cannot be read"),
        (lambda folder: (folder / prebuilt.LIST).write_text("{"), "cannot be read"),
        (lambda folder: (folder / prebuilt.LIST).write_text("[]"), "cannot be read"),
        (lambda folder: (folder / prebuilt.LIST).write_text('{"builds": 3}'), "cannot be read"),
    ],
    ids=["other content", "no library", "half a list", "no list", "no builds"],
)
def test_a_damaged_build_is_not_taken(cores, packed, damage, said):
    cores(HASWELL)
    folder = packed(BOTH)
    prebuilt.library()
    damage(folder)
    with pytest.raises(build.BuildError, match=said):
        prebuilt.library()


def test_a_build_of_other_sources_is_not_taken(cores, packed):
    """Its equations may be others though it takes the same arrays."""
    cores(HASWELL)
    packed(BOTH, sources="0" * 64)
    with pytest.raises(build.BuildError, match="made from other sources"):
        prebuilt.library()


@on_posix
@pytest.mark.parametrize("what", ["x86-64-v3.so", prebuilt.LIST, "."])
@pytest.mark.parametrize("mode", [0o020, 0o002])
def test_a_build_that_more_people_can_change_than_the_code_is_not_taken(cores, packed, what, mode):
    cores(HASWELL)
    path = packed(BOTH) / what
    path.chmod(stat.S_IMODE(path.stat().st_mode) | mode)
    with pytest.raises(build.BuildError, match="can be written by others"):
        prebuilt.library()


@on_posix
@as_root
def test_a_build_of_another_user_is_not_taken_but_that_of_root(cores, packed, monkeypatch):
    """An administrator installs for all; `_user` is who asks."""
    cores(HASWELL)
    folder = packed(BOTH)
    monkeypatch.setattr(private_files, "_user", lambda: 1000)
    prebuilt.library()
    os.chown(folder / "x86-64-v3.so", 12345, -1)
    with pytest.raises(build.BuildError, match="belongs to another user"):
        prebuilt.library()


@on_posix
@as_root
def test_where_a_group_keeps_the_code_it_may_keep_the_build(packed, tmp_path, monkeypatch):
    """A shared environment: owner and group of the code may be those of the library, and no other group."""
    file, code = packed(BOTH) / "x86-64-v3.so", tmp_path / "code.py"
    code.write_text("")
    for path, mode in ((code, 0o664), (file, 0o664), (file.parent, 0o775)):
        os.chown(path, 12345, 77)
        path.chmod(mode)
    monkeypatch.setattr(private_files, "_user", lambda: 1000)
    private_files.check_as_private_as(code, file)
    os.chown(file, 0, 77)
    private_files.check_as_private_as(code, file)
    os.chown(file, 12345, 78)
    with pytest.raises(private_files.NotPrivateError, match="mode 664"):
        private_files.check_as_private_as(code, file)
    code.chmod(0o644)
    os.chown(file, 12345, 77)
    with pytest.raises(private_files.NotPrivateError, match="mode 664"):
        private_files.check_as_private_as(code, file)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> bytes:
    """A library with the whole engine, as the suite's cache has it."""
    return build.library().read_bytes()


@needs_compiler
def test_without_a_compiler_the_prebuilt_engine_computes(whole, packed, cores, unregistered, monkeypatch, caplog):
    """Nothing is said and nothing is lost; with a compiler that one's build is taken."""
    cores(HASWELL)
    packed({"x86-64-v3": whole})
    monkeypatch.setenv("SYSID_ENGINE", "auto")
    monkeypatch.setenv("CXX", "no-such-compiler")
    monkeypatch.setattr(build, "compile_engine", pytest.fail)
    assert engine.engine_versions() == {"engine": "native", "engine_build": "prebuilt for x86-64-v3"}
    assert caplog.messages == []
    library = kernel._loaded(None).library
    assert all(hasattr(library, f"sysid_{entry}") for entry in kernel.ENTRIES)
    again(monkeypatch)
    monkeypatch.setattr(build, "compile_engine", lambda compiler, made, *flags: made.write_bytes(whole))
    assert engine.engine_versions() == {"engine": "native", "engine_build": "compiled on this machine"}


@needs_compiler
@pytest.mark.parametrize("how", ["compiler fails", "library is not loaded"])
def test_where_compiling_fails_the_prebuilt_engine_computes(whole, packed, cores, unregistered, monkeypatch, how):
    """A broken compiler, or a cache folder from which the system runs nothing."""

    def compile_engine(compiler: build.Compiler, made: Path, *flags: str) -> None:
        if how == "compiler fails":
            raise build.BuildError("out of order")
        made.write_bytes(b"no library")

    cores(HASWELL)
    packed({"x86-64-v3": whole})
    monkeypatch.setenv("SYSID_ENGINE", "auto")
    monkeypatch.setattr(build, "compile_engine", compile_engine)
    assert engine.engine_versions()["engine_build"] == "prebuilt for x86-64-v3"


def test_where_there_is_nothing_both_reasons_and_the_remedy_are_said(packed, cores, unregistered, monkeypatch, caplog):
    cores(IVY_BRIDGE)
    packed(BOTH)
    monkeypatch.setenv("SYSID_ENGINE", "auto")
    monkeypatch.setenv("CXX", "no-such-compiler")
    assert engine.engine_versions() == {"engine": "reference"}
    (said,) = caplog.messages
    assert "no C++ compiler was found, and the prebuilt engine needs a processor with AVX2 and FMA." in said
    assert "pip install ziglang" in said


@needs_compiler
def test_what_a_compiler_has_made_is_used_when_it_is_gone(whole, packed, unregistered, monkeypatch):
    packed({"x86-64-v3": whole})
    monkeypatch.setattr(build, "compile_engine", lambda compiler, made, *flags: made.write_bytes(whole))
    made = build.library()
    monkeypatch.setenv("CXX", "no-such-compiler")
    assert build.library() == made
    assert engine.engine_versions()["engine_build"] == "compiled on this machine"
    monkeypatch.setattr(build, "description", lambda: "another processor")
    with pytest.raises(build.BuildError, match="no C\\+\\+ compiler"):
        build.library()


def again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same machine with a compiler, seen by a new process."""
    monkeypatch.delenv("CXX")
    for known in (engine._problem, kernel._loaded, kernel.load):
        known.cache_clear()


@pytest.mark.parametrize(
    ("cxx", "there", "ziglang", "found"),
    [
        (None, {"g++"}, True, ("/bin/g++",)),
        (None, {"clang++", "c++"}, True, ("/bin/c++",)),
        (None, set(), True, (sys.executable, "-m", "ziglang", "c++")),
        (None, set(), False, None),
        ("icpx", {"icpx", "g++"}, True, ("/bin/icpx",)),
        ("icpx", {"g++"}, True, None),
    ],
)
def test_the_compiler_of_ziglang_comes_after_those_of_the_system(monkeypatch, cxx, there, ziglang, found):
    monkeypatch.delenv("CXX", raising=False)
    if cxx is not None:
        monkeypatch.setenv("CXX", cxx)
    monkeypatch.setattr(build.shutil, "which", lambda name: f"/bin/{name}" if name in there else None)
    monkeypatch.setattr(build, "find_spec", lambda name: object() if ziglang and name == "ziglang" else None)
    assert build.find_compiler() == found


def test_zig_keeps_nothing_where_others_may_write(monkeypatch, tmp_path):
    """What it compiles of the C++ library becomes a part of ours."""
    names = ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR", "TMPDIR")
    monkeypatch.setenv(names[0], "/shared")
    show = [sys.executable, "-c", f"import os; print(*(os.environ[n] for n in {names}))"]
    assert build._run(show, tmp_path).stdout.split() == [str(tmp_path)] * 3


@pytest.mark.long
@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed (pip install ziglang)")
def test_zig_compiles_the_engine(tmp_path):
    """As it stands: the library is loaded and takes the arrays of this version."""
    zig = (sys.executable, "-m", "ziglang", "c++")
    build.compile_engine(zig, tmp_path / "engine.so")
    assert kernel.load(tmp_path / "engine.so", "zig").origin == "zig"
