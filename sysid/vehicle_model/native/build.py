"""Compiles the native engine for this machine and keeps the library in the user's cache folder."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from importlib.metadata import version
from pathlib import Path

from sysid.runtime import cache_root

#: Files that make up the engine; the first is the one to compile.
SOURCES = ("engine.cpp", "residuals.h", "vehicle.h", "suspension.h", "contact.h", "row.h", "pack.h")
#: Optimisation for exactly this processor; -O3 keeps the rules of IEEE arithmetic.
FLAGS = ("-std=c++17", "-O3", "-march=native", "-shared", "-fPIC", "-pthread", "-w")
TIMEOUT_S = 300.0


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

    Its name holds a hash of the sources, the compiler, the headers' version and the processor.  It is written under
    another name and renamed, so that processes which build it at the same time do not meet half a file.

    Raises
    ------
    BuildError
        If there is no compiler, it fails, or the cache folder cannot be written.
    """
    compiler = find_compiler()
    if compiler is None:
        raise BuildError("no C++ compiler was found")
    target = cache_root() / f"engine-{_key(compiler)}.so"
    if target.exists():
        return target
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent, prefix="engine-") as folder:
            made = Path(folder) / target.name
            _compile(compiler, made)
            os.replace(made, target)
    except OSError as error:
        raise BuildError(f"the cache folder cannot be written ({error.strerror})") from error
    return target


def _compile(compiler: str, made: Path) -> None:
    import jax

    source = Path(__file__).parent / SOURCES[0]
    command = [compiler, *FLAGS, "-isystem", jax.ffi.include_dir(), str(source), "-o", str(made)]
    done = _run(command)
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
