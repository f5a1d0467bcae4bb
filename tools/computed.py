"""What an installed engine computes, run by ``tools.check_wheel`` in its environment: FILE.npz [BUILD]."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np


def main() -> None:
    """Write where the engine comes from, log-densities, residuals and their Jacobian."""
    file, *only = sys.argv[1:]
    # At the end: the package is the installed one, the work that of the benchmark.
    sys.path.append(str(Path(__file__).resolve().parents[1]))
    import sysid

    if not Path(sysid.__file__).is_relative_to(sys.prefix):
        raise SystemExit("The package that is checked is not the installed one.")
    from benchmarks.work import density, make_work, nominal_point
    from sysid.estimation.residuals.linearisation import linearise
    from sysid.runtime import configure
    from sysid.vehicle_model.engine import engine_versions
    from sysid.vehicle_model.native import build, prebuilt

    configure()
    if only:
        prebuilt.NEEDS = {only[0]: prebuilt.NEEDS[only[0]]}
        build._run = _no_compiler
    work = make_work(nominal_point(), [0])
    point = work.state.point
    (lin,) = linearise(work.model, point.weights, point.log_parameters, point.motion)
    np.savez(
        file,
        origin=np.array(engine_versions().get("engine_build", "reference")),
        density=density(work, "native")(work.sets(16)),
        residual=np.asarray(lin.residual),
        jacobian=np.asarray(lin.residual_jacobian),
    )


def _no_compiler(command: list[str], scratch: Path | None = None) -> None:
    raise SystemExit(f"The program tried to compile: {' '.join(command)}")


if __name__ == "__main__":
    main()
