"""Chains whose process is killed (SIGKILL) again and again: never an unreadable file, and the same chain in the end."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import killed_chain
import pytest
from figures import record

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL")


def killed(folder: Path, kills: int, seed: int) -> dict:
    done = subprocess.run(
        [sys.executable, killed_chain.__file__, str(folder), str(kills), str(seed)],
        capture_output=True,
        text=True,
        check=True,
        timeout=1800,
        env=os.environ | {"PYTHONPATH": os.getcwd()},
    )
    return json.loads(done.stdout)


def check(folder: Path, kills: int, seed: int) -> dict:
    found = killed(folder, kills, seed)
    assert found["killed"] == kills
    assert found["faults"] == []
    assert found["places"] > kills // 4
    resumed = killed_chain.sample(Path(found["chain"]), resume=True)
    whole = killed_chain.sample(folder / "whole")
    assert resumed.draws.tobytes() == whole.draws.tobytes()
    assert resumed.log_probability.tobytes() == whole.log_probability.tobytes()
    assert resumed.summaries == whole.summaries
    assert (resumed.rejected, resumed.acceptance.tobytes()) == (whole.rejected, whole.acceptance.tobytes())
    chain = Path(found["chain"])
    assert {p.name: p.read_bytes() for p in chain.iterdir()} == {
        p.name: p.read_bytes() for p in (folder / "whole").iterdir()
    }
    return found


def test_ten_kills_leave_the_chain_as_it_is(tmp_path):
    check(tmp_path, 10, seed=1)


@pytest.mark.long
def test_two_hundred_kills_leave_the_chain_as_it_is(tmp_path):
    found = check(tmp_path, 200, seed=2)
    record("kills", {name: found[name] for name in ("killed", "places", "completed", "faults")})
