"""Compiles the native engine for this machine and keeps the library where only its user can write."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections import defaultdict
from importlib.util import find_spec
from pathlib import Path

from sysid.private_files import PRIVATE_MODE, NotPrivateError, check_private, write_private
from sysid.runtime import private_cache
from sysid.vehicle_model.native import header
from sysid.vehicle_model.native.buffers import COORDINATES
from sysid.vehicle_model.native.processor import description

#: The words with which the command of a compiler begins.
Compiler = tuple[str, ...]
#: What is compiled, and what it includes beside the header that is made for it.
SOURCES = (
    "engine.cpp",
    "call.h",
    "residuals.h",
    "integration.h",
    "vehicle.h",
    "suspension.h",
    "contact.h",
    "row.h",
    "pack.h",
)
LIBRARY = "engine.so"
#: -O3 keeps the rules of IEEE arithmetic.
FLAGS = ("-std=c++17", "-O3", "-shared", "-fPIC", "-pthread", "-Wall", "-Wextra")
#: Optimisation for exactly this processor.
THIS_PROCESSOR = ("-march=native",)
#: A compiler that has to make its own library first takes three minutes on a busy machine.
TIMEOUT_S = 600.0
NO_COMPILER = "no C++ compiler was found"

#: Folders that a thread of this process fills; another one that needs the same waits. And compilers by the threads that
#: wait for them.
_filled: defaultdict[Path, threading.RLock] = defaultdict(threading.RLock)
_compilers: dict[int, subprocess.Popen[str]] = {}


class BuildError(Exception):
    """Why there is no library, in one sentence."""


def find_compiler() -> Compiler | None:
    """The C++ compiler: the one that CXX names, else the first of c++, g++ and clang++, else that of `ziglang`."""
    named = os.environ.get("CXX")
    for name in [named] if named else ["c++", "g++", "clang++"]:
        path = shutil.which(name)
        if path is not None:
            return (path,)
    return None if named or find_spec("ziglang") is None else (sys.executable, "-m", "ziglang", "c++")


def library(coordinates: int | None = None) -> Path:
    """The engine for vehicles with so many body coordinates, from the cache or compiled now.

    Compiling takes 10 to 20 s, once per machine, version and number of coordinates.  The library's folder is
    named by a hash of the sources and the processor, one of the compiler, and the number; where
    there is no compiler any more, what another one has compiled is used.  A library that is there already is used only
    if it is what this user has put there (:mod:`sysid.private_files`).  The folder is filled under another name and
    renamed, so that processes which build at the same time do not meet half a file.

    Parameters
    ----------
    coordinates : None for a library of whatever number; one is compiled only where there is none.

    Raises
    ------
    BuildError
        If there is no compiler, it fails, or the cache folder cannot be written or is open to others.
    """
    compiler = find_compiler()
    try:
        folder = private_cache("engine")
        if compiler is None:
            return _kept(folder, "*", coordinates)
        key = _key_of(compiler)
        if coordinates is None:
            try:
                return _kept(folder, key, None)
            except BuildError:
                coordinates = COORDINATES[0]
        home = folder / f"{_key()}-{key}-{coordinates}"
        with _filled[home]:
            if not _sound(home / LIBRARY):
                _fill(compiler, home, coordinates)
    except NotPrivateError as error:
        raise BuildError(NO_COMPILER if compiler is None else str(error)) from error
    except OSError as error:
        raise BuildError(
            NO_COMPILER if compiler is None else f"the cache folder cannot be written ({error.strerror})"
        ) from error
    return home / LIBRARY


def _kept(folder: Path, compiler: str, coordinates: int | None) -> Path:
    """What a compiler has made for this machine; `compiler` its hash, or "*" for any."""
    number = "*" if coordinates is None else coordinates
    for home in sorted(folder.glob(f"{_key()}-{compiler}-{number}")):
        if _sound(home / LIBRARY):
            return home / LIBRARY
    raise BuildError(NO_COMPILER)


def _sound(library: Path) -> bool:
    try:
        check_private(library)
    except (NotPrivateError, OSError):
        return False
    return True


def _fill(compiler: Compiler, home: Path, coordinates: int) -> None:
    with tempfile.TemporaryDirectory(dir=home.parent, prefix="build-") as scratch:
        folder = Path(scratch)
        compiled = folder / LIBRARY
        compile_engine(compiler, compiled, f"-DSYSID_COORDINATES={coordinates}")
        made = folder / "made"
        made.mkdir(mode=PRIVATE_MODE)
        write_private(made / LIBRARY, compiled.read_bytes())
        with contextlib.suppress(OSError):
            os.rename(made, home)
        if not _sound(home / LIBRARY):
            # What stands there is not ours: out of the way with it.
            os.rename(home, folder / "unsound")
            os.rename(made, home)


def compile_engine(compiler: Compiler, made: Path, *flags: str, processor: tuple[str, ...] = THIS_PROCESSOR) -> None:
    """Compile the engine to the library `made`, its header beside it; `flags` may set the number of coordinates.

    `processor` are the flags that choose a processor.

    Raises
    ------
    BuildError
        If the compiler fails.
    """
    source = str(Path(__file__).parent / SOURCES[0])
    header.write(made.parent)
    include = ["-I", str(made.parent)]
    done = _run([*compiler, *FLAGS, *processor, *flags, *include, source, "-o", str(made)], made.parent)
    if done.returncode != 0 or not made.exists():
        lines = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines()
        message = lines[0].strip() if lines else "without a message"
        raise BuildError(f"the compiler {' '.join(compiler)} failed ({message})")


def source_digest() -> str:
    """Hash of all that the engine is compiled from."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((Path(__file__).parent / name).read_bytes())
    digest.update(header.header().encode())
    return digest.hexdigest()


def _run(command: list[str], scratch: Path | None = None) -> subprocess.CompletedProcess[str]:
    # In the folder that is private to us and gone afterwards: what a compiler leaves when it is ended, and the C++
    # library that Zig compiles first.
    names = () if scratch is None else ("TMPDIR", "ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")
    kept = dict.fromkeys(names, str(scratch))
    # Ctrl-C ends the compiler that the user waits for.
    beside = threading.current_thread() is not threading.main_thread()
    try:
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            env=os.environ | kept,
            start_new_session=beside,
        )
    except OSError as error:
        raise BuildError(f"the compiler {command[0]} cannot be run ({error})") from error
    thread = threading.get_ident()
    with process:
        _compilers[thread] = process
        try:
            said = process.communicate(timeout=TIMEOUT_S)
        except subprocess.TimeoutExpired as error:
            raise BuildError(f"the compiler {command[0]} cannot be run ({error})") from error
        finally:
            del _compilers[thread]
            if process.returncode is None:
                _end(process)
    return subprocess.CompletedProcess(command, process.returncode, *said)


def end_compiler_of(thread: threading.Thread) -> None:
    """End the compiler that a thread beside the main one waits for, if there is one."""
    process = _compilers.get(thread.ident or 0)
    if process is not None:
        _end(process)


def _end(process: subprocess.Popen[str]) -> None:
    """End a compiler; where it is in a group of its own, with the processes that it has started."""
    with contextlib.suppress(OSError):
        if hasattr(os, "killpg") and os.getpgid(process.pid) == process.pid:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


def _key() -> str:
    """What a library depends on beside the compiler."""
    parts = [source_digest(), *FLAGS, *THIS_PROCESSOR, platform.machine(), description()]
    return _short(" ".join(parts))


def _key_of(compiler: Compiler) -> str:
    return _short(" ".join(compiler) + _run([*compiler, "--version"]).stdout)


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
