"""The native engine's own sources compiled into a program without Python: the limit of the native path."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path

import numpy as np

from benchmarks.rounds import Sample
from benchmarks.work import Work
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.posterior.log_density import LogDensity
from sysid.vehicle_model.engines.native import misfit_call
from sysid.vehicle_model.native import build, header

_HERE = Path(__file__).parent / "bare"


def compile_program(folder: Path) -> Path:
    """Compile the program with the compiler and the flags of the engine.

    Raises
    ------
    BuildError
        If there is no compiler or it fails.
    """
    return compile_sources(folder / "bare_kernel", Path(build.__file__).parent)


def compile_sources(program: Path, sources: Path, flags: tuple[str, ...] = ()) -> Path:
    """Compile the program from the engine's sources in a folder, with more flags than those of the engine.

    Raises
    ------
    BuildError
        If there is no compiler or it fails.
    """
    compiler = build.find_compiler()
    if compiler is None:
        raise build.BuildError("no C++ compiler was found")
    own = [flag for flag in (*build.FLAGS, *build.THIS_PROCESSOR) if flag not in ("-shared", "-fPIC")]
    header.write(program.parent)
    include = ["-I", str(_HERE), "-I", str(program.parent), "-I", str(sources)]
    done = subprocess.run(
        [*compiler, *own, *flags, *include, str(_HERE / "main.cpp"), "-o", str(program)],
        capture_output=True,
        text=True,
        timeout=build.TIMEOUT_S,
        check=False,
    )
    if done.returncode != 0:
        raise build.BuildError(f"the bare kernel does not compile: {done.stderr.splitlines()[:1]}")
    return program


class BareKernel:
    """A running program that holds the likelihoods of one group of runs for several batches."""

    def __init__(self, program: Path, folder: Path, work: Work, density: LogDensity, batches: list[np.ndarray]):
        if len(density._inputs) != 1:
            raise ValueError("the bare kernel takes one group of runs; choose runs with records of one length")
        files = [folder / f"call{k}.bin" for k in range(len(batches))]
        for file, sets in zip(files, batches, strict=True):
            write_call(file, work, density, sets)
        self._process = subprocess.Popen(
            [str(program), *map(str, files)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def measure(self, batch: int, repeats: int = 1) -> tuple[Sample, float]:
        """Time of one likelihood of a batch, and the sum of its misfits."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{batch} {repeats}\n")
        self._process.stdin.flush()
        wall, processor, misfit = map(float, self._process.stdout.readline().split())
        return Sample(wall / repeats, processor / repeats), misfit

    def close(self) -> None:
        """End the program."""
        self._process.communicate()


def write_call(file: Path, work: Work, density: LogDensity, sets: np.ndarray, group: int = 0) -> None:
    """One group's call of the entry point `misfits` for parameter sets (n, p), in the form that ``main.cpp`` reads."""
    inputs = density._inputs[group]
    arrays, shape = inputs.arrays, work.model.shapes[group]
    call = misfit_call(
        arrays.matrices,
        axle_laws(arrays.laws, sets.T),
        inputs.road,
        shape.timing,
        shape.sensors,
        shape.recursion,
        arrays.readings(inputs.noise_sd, inputs.tempering),
        inputs.columns,
    )
    every, settings = call.ordered(), call.settings
    with file.open("wb") as out:

        def put(values: object, kind: str) -> None:
            flat = np.ascontiguousarray(values, kind).ravel()
            out.write(struct.pack("q", flat.size))
            out.write(flat.tobytes())

        integers = ("samples", "substeps", "elements", "ramps", "stops", "rate_ramps")
        put([*(settings[name] for name in integers), len(every)], "i8")
        put([settings["interval"]], "f8")
        put(settings["deflection_axles"], "i8")
        put(settings["acceleration_axles"], "i8")
        for buffer in every:
            put(np.shape(buffer), "i8")
            put(buffer, "f8")
