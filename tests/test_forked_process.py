"""Processes that are forked after a calibration say so at once; those that are spawned compute."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="no fork on this system")

SCRIPT = """
import multiprocessing, sys, warnings
import numpy as np
warnings.simplefilter("ignore")

def computed(_):
    import jax.numpy as jnp
    from sysid.errors import SysidError
    from sysid.runtime import configure, require_64_bit
    try:
        configure()
        require_64_bit()
        return float(np.asarray(jnp.linalg.solve(jnp.eye(300) * 2.0, jnp.ones(300))).sum())
    except SysidError as error:
        return str(error)

def engine(_):
    from sysid.errors import SysidError
    from sysid.vehicle_model.native.kernel import Call, run
    try:
        return run(Call("", {}, {}, {}))
    except SysidError as error:
        return str(error)

if __name__ == "__main__":
    method, before = sys.argv[1:]
    if before == "after":
        computed(0)
    with multiprocessing.get_context(method).Pool(1) as pool:
        print(pool.map_async(computed, [0]).get(timeout=100))
        if before == "after" and method == "fork":
            print(pool.map_async(engine, [0]).get(timeout=100))
"""


def said(tmp_path, method: str, before: str) -> list[str]:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), method, before]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=True)
    return done.stdout.splitlines()


def test_a_fork_after_computing_is_refused_with_the_remedy(tmp_path) -> None:
    lines = said(tmp_path, "fork", "after")
    assert len(lines) == 2
    assert all("forked from one that had computed" in line and "get_context('spawn')" in line for line in lines)


@pytest.mark.parametrize(("method", "before"), [("spawn", "after"), ("fork", "before")])
def test_other_processes_compute(tmp_path, method: str, before: str) -> None:
    assert said(tmp_path, method, before) == ["[150.0]"]
