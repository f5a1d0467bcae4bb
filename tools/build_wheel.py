"""A wheel that carries the native engine: ``python -m tools.build_wheel --output build/wheel``.

The engine knows nothing of Python or JAX, so one wheel serves all their versions.  Zig compiles it: whatever machine
makes the wheel, the engine then needs no newer C library than that of `GLIBC`, and no C++ library.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from sysid.vehicle_model.native import build
from sysid.vehicle_model.native.build import source_digest
from sysid.vehicle_model.native.prebuilt import FOLDER, LIST

ROOT = Path(__file__).resolve().parents[1]
#: Every Linux that a jaxlib is made for has it.
GLIBC = "2.17"
#: Time of the files in a wheel [s since 1970]: the first that a ZIP archive can hold, a day later.
TIME = "315619200"
ZIG = (sys.executable, "-m", "ziglang", "c++")
#: Builds by the architecture of this machine, with Zig's names of the processors.
BUILDS = {"x86_64": {"x86-64-v4": "x86_64_v4", "x86-64-v3": "x86_64_v3"}, "aarch64": {"generic": "generic"}}
#: Names of the C++ library inside must not meet those of the one that jaxlib loads.
EXPORTS = "{ global: sysid_*; local: *; };\n"


def main() -> None:
    """Make the wheel and print its path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "wheel")
    options = parser.parse_args()
    output = options.output.resolve()
    output.mkdir(parents=True, exist_ok=True)
    engine = output / "engine"
    build.TIMEOUT_S = 3600.0
    make_engine(engine)
    sys.stdout.write(f"{make_wheel(output, engine)}\n")


def make_engine(folder: Path) -> None:
    """All builds of the engine and their list, unless they are there for the same sources."""
    listed = {"sources": source_digest(), "glibc": GLIBC}
    if (folder / LIST).is_file():
        known = json.loads((folder / LIST).read_text(encoding="utf-8"))
        if {key: known.get(key) for key in listed} == listed:
            return
    machine = platform.machine()
    if machine not in BUILDS:
        raise SystemExit(f"There is no build for {machine}: add it to BUILDS in tools/build_wheel.py.")
    # What an interrupted call has compiled is kept: the whole takes minutes.
    scratch = folder.with_name(f"engine-{source_digest()[:16]}")
    scratch.mkdir(exist_ok=True)
    hashes = {name: _built(name, processor, scratch) for name, processor in BUILDS[machine].items()}
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name in hashes:
        shutil.move(scratch / f"{name}.so", folder)
    (folder / LIST).write_text(json.dumps({**listed, "builds": hashes}, indent=1) + "\n", encoding="utf-8")
    shutil.rmtree(scratch)


def _built(name: str, processor: str, scratch: Path) -> str:
    """The sha256 of the file of that name, compiled if it is not there."""
    file, made, exports = scratch / f"{name}.so", scratch / "engine.so", scratch / "exports"
    if not file.is_file():
        exports.write_text(EXPORTS, encoding="ascii")
        link = (f"-Wl,--version-script={exports}", "-Wl,--gc-sections", "-s")
        target = ("-target", f"{platform.machine()}-linux-gnu.{GLIBC}", f"-mcpu={processor}")
        build.compile_engine(ZIG, made, *link, processor=target)
        made.rename(file)
    return hashlib.sha256(file.read_bytes()).hexdigest()


def make_wheel(output: Path, engine: Path) -> Path:
    """A plain wheel of a copy of the sources, with the engine put in and the tag that its libraries allow."""
    with tempfile.TemporaryDirectory(dir=output) as scratch:
        source, plain, open_ = (Path(scratch) / name for name in ("source", "plain", "open"))
        # A copy: what earlier installations have left in the checkout must not get in.
        shutil.copytree(ROOT / "sysid", source / "sysid", ignore=shutil.ignore_patterns("__pycache__", FOLDER.name))
        for name in ("pyproject.toml", "README.md", "LICENSE"):
            shutil.copy2(ROOT / name, source)
        shutil.copytree(ROOT / "requirements", source / "requirements")
        _python("pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(plain), str(source))
        (wheel,) = plain.glob("*.whl")
        _python("wheel", "unpack", "--dest", str(open_), str(wheel))
        (unpacked,) = open_.iterdir()
        inside = unpacked / FOLDER.relative_to(ROOT)
        inside.mkdir()
        for file in engine.iterdir():
            shutil.copy2(file, inside)
        _no_longer_pure(unpacked)
        _python("wheel", "pack", "--dest-dir", scratch, str(unpacked))
        (packed,) = Path(scratch).glob("*.whl")
        tag = allowed_tag(packed)
        name = _python("wheel", "tags", "--remove", "--platform-tag", tag, str(packed)).strip().splitlines()[-1]
        for old in output.glob("*.whl"):
            old.unlink()
        return Path(shutil.move(packed.with_name(name), output))


def allowed_tag(wheel: Path) -> str:
    """The platform tag with the oldest systems on which the libraries of a wheel can be loaded."""
    found = json.loads(_python("auditwheel", "show", "--json", "--disable-isa-ext-check", str(wheel)))
    return str(found["overall_tag"])


def _no_longer_pure(unpacked: Path) -> None:
    (file,) = unpacked.glob("*.dist-info/WHEEL")
    text = file.read_text(encoding="utf-8").replace("Root-Is-Purelib: true", "Root-Is-Purelib: false")
    file.write_text(text.replace("Tag: py3-none-any", f"Tag: py3-none-linux_{platform.machine()}"), encoding="utf-8")


def _python(module: str, *arguments: str) -> str:
    # One time for all files inside, whoever makes the wheel and when.
    environment = {"SOURCE_DATE_EPOCH": TIME, **os.environ}
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        raise SystemExit(f"{module} {' '.join(arguments)} failed: {done.stderr.strip()}")
    return done.stdout


if __name__ == "__main__":
    main()
