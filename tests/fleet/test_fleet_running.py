"""Faults of every kind cost one campaign each, nothing finished is computed twice, and every failure is named."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fleet_child import COMMAND, DIGEST, write_campaigns

from sysid.errors import CampaignError, OutputError
from sysid.fleet import key, running
from sysid.fleet.outcome import Outcome, read_outcome
from sysid.fleet.read import read_fleet
from sysid.fleet.running import Row, RunOptions, exit_code, run_fleet, worker_count
from sysid.fleet.status import rows_on_disk, write_status
from sysid.folder_lock import FolderLock

SUPPORT = Path(__file__).resolve().parents[1] / "support"


@pytest.fixture(autouse=True)
def same_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """The driver takes the program for that of the stand-in."""
    monkeypatch.setattr(key, "program_digest", lambda: DIGEST)


def run(folder: Path, output: Path, **options) -> dict[str, Row]:
    rows = run_fleet(read_fleet(folder), output, RunOptions(2, command=COMMAND, **options), lambda rows: None)
    return {row.campaign: row for row in rows}


def starts(output: Path, name: str) -> int:
    file = output / "campaigns" / name / "starts"
    return len(file.read_text().splitlines()) if file.exists() else 0


def test_one_failure_stops_no_other_and_every_failure_is_named(tmp_path: Path) -> None:
    folder = write_campaigns(
        tmp_path / "fleet", a="done", b="rejected Axle 2 has no load.", c="die", d="not-converged", e="done"
    )
    output = tmp_path / "out"
    rows = run(folder, output)
    assert {n: r.state for n, r in rows.items()} == {
        "a": "done", "b": "rejected", "c": "crashed", "d": "not converged", "e": "done",
    }  # fmt: skip
    assert rows["b"].outcome.sentence == "Axle 2 has no load."
    assert "died 2 times (signal SIGSEGV)" in rows["c"].outcome.sentence
    assert "a wild pointer" in rows["c"].outcome.sentence
    assert exit_code(rows.values()) == 3
    table, _ = write_status(list(rows.values()), output)
    told = {c["campaign"]: c["sentence"] for c in json.loads(table.read_text())["campaigns"]}
    assert told["b"] == "Axle 2 has no load."
    assert [r.state for r in rows_on_disk(read_fleet(folder), output)] == [r.state for r in rows.values()]


def test_unchanged_campaigns_are_not_computed_again(tmp_path: Path) -> None:
    folder, output = (
        write_campaigns(tmp_path / "fleet", a="done", b="rejected No.", c="die", d="not-converged"),
        tmp_path / "out",
    )
    run(folder, output)
    assert [starts(output, n) for n in "abcd"] == [1, 1, 2, 1]
    run(folder, output)
    assert [starts(output, n) for n in "abcd"] == [1, 1, 2, 1]
    run(folder, output, retry=("failed",))
    assert [starts(output, n) for n in "abcd"] == [1, 2, 4, 1]
    run(folder, output, retry=("not-converged",))
    assert [starts(output, n) for n in "abcd"] == [1, 2, 4, 2]
    # Another input, another option, a result that is gone or damaged: computed again.
    (folder / "a" / "campaign.toml").write_text('title = "other"\n')
    run(folder, output)
    assert [starts(output, n) for n in "abcd"] == [2, 2, 4, 2]
    (output / "campaigns" / "a" / "result.json").write_text("{}")
    run(folder, output)
    assert starts(output, "a") == 3
    run(folder, output, choices={"seed": 5})
    assert [starts(output, n) for n in "ad"] == [4, 3]


def test_a_rejected_campaign_that_was_mended_is_computed(tmp_path: Path) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="rejected No."), tmp_path / "out"
    assert run(folder, output)["a"].state == "rejected"
    (folder / "a" / "behaviour").write_text("done")
    assert run(folder, output)["a"].state == "done"


def test_a_process_that_dies_once_is_started_again(tmp_path: Path) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="die-once"), tmp_path / "out"
    row = run(folder, output)["a"]
    assert (row.state, row.outcome.attempts, starts(output, "a")) == ("done", 2, 2)


def test_a_worker_that_is_killed_in_a_stage_loses_nothing(tmp_path: Path) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="wait-once 60", b="done"), tmp_path / "out"
    killed = []

    def kill(rows: list[Row]) -> None:
        if not killed and starts(output, "a") == 1:
            killed.append(int((output / "campaigns/a/starts").read_text()))
            os.kill(killed[0], signal.SIGKILL)

    rows = run_fleet(read_fleet(folder), output, RunOptions(2, command=COMMAND), kill)
    assert len(killed) == 1
    assert [row.state for row in rows] == ["done", "done"]
    assert (starts(output, "a"), starts(output, "b")) == (2, 1)


def test_twenty_workers_that_are_killed_lose_nothing(tmp_path: Path) -> None:
    names = [f"w{n:02d}" for n in range(20)]
    folder, output = (
        write_campaigns(tmp_path / "fleet", **dict.fromkeys(names, "wait-once 60"), x="done"),
        tmp_path / "out",
    )
    killed: dict[str, int] = {}

    def kill(rows: list[Row]) -> None:
        for name in names:
            if name not in killed and starts(output, name) == 1:
                killed[name] = int((output / "campaigns" / name / "starts").read_text())
                os.kill(killed[name], signal.SIGKILL)

    rows = run_fleet(read_fleet(folder), output, RunOptions(2, command=COMMAND), kill)
    assert len(killed) == 20
    assert {row.state for row in rows} == {"done"}
    assert {row.campaign: (starts(output, row.campaign), row.outcome.attempts) for row in rows} == {
        **dict.fromkeys(names, (2, 2)),
        "x": (1, 1),
    }


def test_a_folder_that_cannot_be_written_costs_its_campaign_only(tmp_path: Path) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="done", b="done"), tmp_path / "out"
    (output / "campaigns").mkdir(parents=True)
    # A full disk for one campaign: /dev/full takes nothing.
    (output / "campaigns" / "a").mkdir()
    (output / "campaigns" / "a" / "fleet.log").symlink_to("/dev/full")
    (output / "campaigns" / "a" / "fleet_starts.json").mkdir()
    rows = run(folder, output)
    assert (rows["a"].state, rows["b"].state) == ("failed", "done")
    assert "cannot be written" in rows["a"].outcome.sentence
    assert "Is a directory" in rows["a"].outcome.sentence
    assert starts(output, "a") == 0


def test_a_real_calibration_on_a_full_disk_says_so(tmp_path: Path, monkeypatch) -> None:
    import errno

    from sysid.fleet import child

    def full(*given: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(child, "_run", full)
    outcome = child.calibrate(tmp_path, tmp_path / "out", {}, lambda message, fraction: None)
    assert outcome.state == "failed"
    assert "No space left on device" in outcome.sentence
    assert "free some space" in outcome.sentence


DRIVER = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from fleet_child import COMMAND, DIGEST, write_campaigns
from sysid.fleet.read import read_fleet
from sysid.fleet.running import RunOptions, run_fleet
run_fleet(read_fleet(Path(sys.argv[2])), Path(sys.argv[3]), RunOptions(2, command=COMMAND), lambda rows: None)
"""


def test_a_killed_driver_goes_on_where_it_was(tmp_path: Path) -> None:
    folder, output = (
        write_campaigns(tmp_path / "fleet", a="done", b="done", c="wait-once 60", d="wait-once 60"),
        tmp_path / "out",
    )
    driver = subprocess.Popen([sys.executable, "-c", DRIVER, str(SUPPORT), str(folder), str(output)])
    deadline = time.monotonic() + 60.0
    while (starts(output, "c"), starts(output, "d")) != (1, 1):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    left = [int((output / "campaigns" / n / "starts").read_text()) for n in "cd"]
    while any(_alive(p) for p in left):
        assert time.monotonic() < deadline, "processes outlive their driver"
        time.sleep(0.05)
    assert {r.state for r in list(rows_on_disk(read_fleet(folder), output))[2:]} <= {"running", "queued", "interrupted"}
    rows = run(folder, output)
    assert {row.state for row in rows.values()} == {"done"}
    # Nothing finished was computed twice, and being killed with the driver does not count against a campaign.
    assert [starts(output, n) for n in "abcd"] == [1, 1, 2, 2]
    assert rows["c"].outcome.attempts == 1


def _alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def test_a_second_run_on_one_folder_is_refused(tmp_path: Path) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="done"), tmp_path / "out"
    with FolderLock(output), pytest.raises(OutputError, match="Another process"):
        run(folder, output)
    # A single campaign for another scheduler has the lock of its own folder.
    with FolderLock(output):
        assert list(run(folder, output, only=("a",))) == ["a"]
    with pytest.raises(CampaignError, match="no campaign 'b'"):
        run(folder, output, only=("b",))


def test_an_interrupt_ends_the_processes_and_keeps_what_is_done(tmp_path: Path) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="done", b="wait 60"), tmp_path / "out"

    def interrupt(rows: list[Row]) -> None:
        if rows[0].state == "done" and starts(output, "b"):
            raise KeyboardInterrupt

    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        run_fleet(read_fleet(folder), output, RunOptions(2, command=COMMAND), interrupt)
    assert time.monotonic() - begin < 30.0
    assert read_outcome(output / "campaigns" / "a").state == "done"
    assert read_outcome(output / "campaigns" / "b") is None
    assert not _alive(int((output / "campaigns/b/starts").read_text()))


def test_workers_share_cores_and_memory(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("SYSID_THREADS", "8")
    monkeypatch.setattr(running, "available_bytes", lambda: 5_000_000_000)
    assert worker_count(None, 100) == 3
    assert worker_count(None, 2) == 2
    assert worker_count(7, 100) == 7
    folder, output = write_campaigns(tmp_path / "fleet", a="done", b="done", c="done"), tmp_path / "out"
    run(folder, output)
    # Eight threads for two processes.
    assert json.loads((output / "campaigns/a/result.json").read_text())["threads"] == "4"


def test_processes_wait_for_memory(monkeypatch) -> None:
    monkeypatch.setattr(running, "available_bytes", lambda: 1_000)
    assert running._room(10_000, 0, RunOptions())
    assert not running._room(10_000, 1, RunOptions())
    assert running._room(900, 1, RunOptions())
    # The memory of a cluster is not that of this machine.
    assert running._room(10_000, 1, RunOptions(scheduler="tcp://somewhere"))


@pytest.mark.parametrize(
    ("states", "code"), [(("done",), 0), (("done", "not converged"), 4), (("not converged", "rejected"), 3)]
)
def test_exit_codes(states: tuple[str, ...], code: int) -> None:
    assert exit_code([Row("t", "", "c", "", s, Outcome("done")) for s in states]) == code
