"""Compiles the native engine for this machine and keeps the library where only its user can write."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from importlib.metadata import version
from pathlib import Path

from sysid.private_files import PRIVATE_MODE, NotPrivateError, check_private, write_private
from sysid.runtime import private_cache
from sysid.vehicle_model.native import header

#: Files that make up the engine beside the header that is made for it; the first is the one to compile.
SOURCES = ("engine.cpp", "residuals.h", "vehicle.h", "suspension.h", "contact.h", "row.h", "pack.h")
#: Optimisation for exactly this processor; -O3 keeps the rules of IEEE arithmetic.
FLAGS = ("-std=c++17", "-O3", "-march=native", "-shared", "-fPIC", "-pthread", "-Wall", "-Wextra")
TIMEOUT_S = 300.0
_NAME = "engine.so"


class BuildError(Exception):
    """Why there is no library, in one sentence."""


def find_compiler() -> str | None:
    """Path of the C++ compiler: the one that CXX names, else the first of c++, g++ and clang++."""
    named = os.environ.get("CXX")
    for name in [named] if named else ["c++", "g++", "clang++"]:
        path = shutil.which(name)
        if path is not None:
            return path
    return None


def library() -> Path:
    """The compiled engine, from the cache or built now (about half a minute, once per machine and version).

    Its folder is named by a hash of the sources, the compiler, the headers' version and the processor.  A library that
    is there already is used only if it is what this user has put there (:mod:`sysid.private_files`).  The folder is
    filled under another name and renamed, so that processes which build at the same time do not meet half a file.

    Raises
    ------
    BuildError
        If there is no compiler, it fails, or the cache folder cannot be written or is open to others.
    """
    compiler = find_compiler()
    if compiler is None:
        raise BuildError("no C++ compiler was found")
    try:
        home = private_cache("engine") / _key(compiler)
        if not _sound(home):
            _fill(compiler, home)
    except NotPrivateError as error:
        raise BuildError(str(error)) from error
    except OSError as error:
        raise BuildError(f"the cache folder cannot be written ({error.strerror})") from error
    return home / _NAME


def _sound(home: Path) -> bool:
    try:
        check_private(home / _NAME)
    except (NotPrivateError, OSError):
        return False
    return True


def _fill(compiler: str, home: Path) -> None:
    with tempfile.TemporaryDirectory(dir=home.parent, prefix="build-") as scratch:
        folder = Path(scratch)
        compiled = folder / _NAME
        compile_engine(compiler, compiled)
        made = folder / "made"
        made.mkdir(mode=PRIVATE_MODE)
        write_private(made / _NAME, compiled.read_bytes())
        with contextlib.suppress(OSError):
            os.rename(made, home)
        if not _sound(home):
            # What stands there is not ours: out of the way with it.
            os.rename(home, folder / "unsound")
            os.rename(made, home)


def compile_engine(compiler: str, made: Path, *flags: str) -> None:
    """Compile the library to the file `made`, its header beside it.

    Raises
    ------
    BuildError
        If the compiler fails.
    """
    import jax

    source = Path(__file__).parent / SOURCES[0]
    header.write(made.parent)
    include = ["-I", str(made.parent), "-isystem", jax.ffi.include_dir()]
    done = _run([compiler, *FLAGS, *flags, *include, str(source), "-o", str(made)])
    if done.returncode != 0 or not made.exists():
        lines = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines()
        raise BuildError(f"the compiler {compiler} failed ({lines[0].strip() if lines else 'without a message'})")


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BuildError(f"the compiler {command[0]} cannot be run ({error})") from error


def _key(compiler: str) -> str:
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((Path(__file__).parent / name).read_bytes())
    digest.update(header.header().encode())
    digest.update(_run([compiler, "--version"]).stdout.encode())
    digest.update(" ".join([*FLAGS, version("jaxlib"), _processor()]).encode())
    return digest.hexdigest()[:16]


def _processor() -> str:
    """What the machine's code depends on: architecture, model and instruction sets of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    first = lines[: lines.index("")] if "" in lines else lines
    wanted = ("model name", "flags", "Features", "CPU part")
    return " ".join([platform.machine(), platform.processor(), *(x for x in first if x.startswith(wanted))])
