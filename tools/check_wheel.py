"""Does a machine without a compiler compute with the engine of a wheel? ``python -m tools.check_wheel build/wheel``.

The wheel is installed into a new environment whose PATH holds nothing else.  There the engine in use must be the
prebuilt one without an attempt to compile; every build must give the results of the one that the compiler of this
machine makes; and the tests that hold the engines equal must pass with it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from sysid.vehicle_model.native.build import find_compiler
from sysid.vehicle_model.native.prebuilt import FOLDER, NEEDS
from sysid.vehicle_model.native.processor import flags

ROOT = Path(__file__).resolve().parents[1]
TWINS = (
    "tests/vehicle_model/test_native_engine.py",
    "tests/estimation/test_native_residuals.py",
)
#: Log-densities are sums of 1e4 squares that builds round in other ways; 1e-14 is found.
TOLERANCE = 1e-12


def main() -> None:
    """Say what was found; exit 1 where the wheel does not hold."""
    (wheel,) = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "wheel").glob("*.whl")
    say = sys.stdout.write
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        python = _environment(folder, wheel)
        names = [name for name, needed in NEEDS.items() if needed <= flags() and _has(python, name)]
        if not names:
            raise SystemExit(f"{wheel.name} carries no build that this processor runs.")
        found = {name: _results(python, folder, name) for name in names}
        origin = str(found[names[0]]["origin"])
        say(f"{wheel.name}: without a compiler the engine is {origin}\n")
        good = origin == f"prebuilt for {names[0]}"
        if find_compiler() is None:
            say("There is no compiler on this machine: results are not compared with those of a compiled engine.\n")
        else:
            compiled = _results(python, folder, None)
            for name, results in found.items():
                apart = max(_apart(results[key], compiled[key]) for key in ("density", "residual", "jacobian"))
                say(f"{name} and {compiled['origin']}: {apart:.1e} apart\n")
                good &= apart < TOLERANCE
        good &= _twins(python, folder)
    raise SystemExit(0 if good else 1)


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference as a share of the largest value."""
    return float(np.abs(one - other).max() / np.abs(other).max())


def _environment(folder: Path, wheel: Path) -> Path:
    """Python of a new environment with the wheel and what the twins' tests need."""
    subprocess.run([sys.executable, "-m", "venv", str(folder / "env")], check=True)
    python = folder / "env" / "bin" / "python"
    install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*install, str(wheel), "pytest"], check=True)
    return python


def _has(python: Path, name: str) -> bool:
    (site,) = python.parents[1].glob("lib/python*/site-packages")
    return (site / "sysid" / "vehicle_model" / "native" / FOLDER.name / f"{name}.so").is_file()


def _alone(python: Path, folder: Path) -> dict[str, str]:
    """Environment variables of a machine without a compiler, and empty caches."""
    kept = {key: value for key, value in os.environ.items() if key not in ("CXX", "PYTHONPATH", "SYSID_ENGINE")}
    return kept | {"PATH": str(python.parent), "SYSID_CACHE_DIR": str(folder / "cache"), "JAX_PLATFORMS": "cpu"}


def _results(python: Path, folder: Path, name: str | None) -> dict[str, np.ndarray]:
    """Results by one of the prebuilt engines, by the compiled one without a name."""
    file, variables = folder / f"{name}.npz", _alone(python, folder)
    if name is None:
        variables["PATH"] = os.environ["PATH"]
    command = [str(python), "-P", str(ROOT / "tools" / "computed.py"), str(file), *([] if name is None else [name])]
    subprocess.run(command, check=True, cwd=folder, env=variables)
    with np.load(file) as arrays:
        return dict(arrays)


def _twins(python: Path, folder: Path) -> bool:
    """Whether the tests of the engines against each other pass, away from the checkout."""
    away = folder / "away"
    shutil.copytree(ROOT / "tests", away / "tests", ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
    shutil.copy2(ROOT / "pyproject.toml", away)
    command = [str(python), "-P", "-m", "pytest", "-q", "-o", "pythonpath=", "-p", "no:cacheprovider", *TWINS]
    done = subprocess.run(command, cwd=away, env=_alone(python, folder), capture_output=True, text=True, check=False)
    last = done.stdout.strip().splitlines()[-1:] or [done.stderr.strip()]
    sys.stdout.write(f"Tests of the engines against each other: {last[0]}\n")
    return done.returncode == 0 and "skipped" not in last[0]


if __name__ == "__main__":
    main()
