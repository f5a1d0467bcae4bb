"""Files of campaigns on their way to workers and back: all that is needed, nothing else, complete or not at all."""

from __future__ import annotations

import asyncio
import os
import tempfile
import zipfile
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import pytest
from fleet_child import COMMAND, DIGEST, write_campaigns

from sysid.errors import CampaignError, OutputError
from sysid.fleet import key, running, sent_files, task
from sysid.fleet.executors import ClusterWorkers
from sysid.fleet.outcome import Outcome, read_outcome
from sysid.fleet.read import read_fleet
from sysid.fleet.running import RunOptions, run_fleet
from sysid.fleet.sent_files import campaign_files, packed, result_files, run_elsewhere, unpack
from sysid.fleet.task import Task
from sysid.folder_lock import FolderLock


class Here(Executor):
    """Workers of a cluster that is this process; the first `lost` tasks are lost with their scheduler."""

    def __init__(self, workers: int = 2, lost: int = 0):
        self.workers, self.lost, self.submitted = workers, lost, 0

    def submit(self, fn, /, *args, **kwargs) -> Future:
        self.submitted += 1
        future: Future = Future()
        if self.submitted <= self.lost:
            future.set_exception(CancelledError())
        else:
            future.set_result(fn(*args, **kwargs))
        return future

    def size(self) -> int:
        return self.workers


@pytest.fixture(autouse=True)
def same_program(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(key, "program_digest", lambda: DIGEST)
    monkeypatch.setenv("SYSID_THREADS", "1")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    (tmp_path / "scratch").mkdir(mode=0o700)


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Here:
    here = Here()

    @contextmanager
    def executor(address: str, patience_s: float = 0.0):
        yield here

    monkeypatch.setattr(running, "cluster_executor", executor)
    return here


def run(folder: Path, output: Path, **options):
    options = RunOptions(2, "tcp://nowhere", send_files=True, command=COMMAND, **options)
    return {row.campaign: row for row in run_fleet(read_fleet(folder), output, options, lambda rows: None)}


def starts(output: Path, name: str) -> int:
    return len((output / "campaigns" / name / "starts").read_text().splitlines())


@pytest.mark.parametrize("name", ["../out", "/etc/passwd", "a/../../b", "."])
def test_packed_files_stay_in_their_folder(tmp_path: Path, name: str) -> None:
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(name, "x")
    with pytest.raises(CampaignError, match="leads out of its folder"):
        unpack(buffer.getvalue(), tmp_path / "in")
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


def test_what_a_campaign_names_is_sent_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    (folder / "logs").mkdir(parents=True)
    secret = tmp_path / "secret"
    secret.write_text("key")
    for name in ("logs/run 12:30.csv", "Straße.csv", "other.csv", "big.zip"):
        (folder / name).write_text(name * 1000)
    (folder / "outside.csv").symlink_to(secret)
    (folder / "linked").symlink_to(folder / "logs")
    files = ["logs/run 12:30.csv", "Straße.csv", "outside.csv", "../secret", "not there.csv", "linked/run 12:30.csv"]
    text = f"title = 'logs'\nfiles = {files}\n[scan.b]\nfile = 'other.csv'\n"
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    names = campaign_files(folder)
    assert names == ["campaign.toml", "logs/run 12:30.csv", "Straße.csv", "linked/run 12:30.csv", "other.csv"]
    content = packed(folder, names)
    assert content == packed(folder, names)
    assert len(content) < 4000, "nothing was compressed"
    unpack(content, tmp_path / "there")
    for name in names:
        assert (tmp_path / "there" / name).read_bytes() == (folder / name).read_bytes()
    # A file that cannot be read as TOML, however it is broken, goes alone: the worker says what is wrong.
    (folder / "campaign.toml").write_text("a" + ".a" * 20000 + " = 1")
    assert campaign_files(folder) == ["campaign.toml"]


def test_a_worker_without_a_place_costs_no_results(tmp_path: Path, cluster: Here, monkeypatch) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="not-converged"), tmp_path / "out"
    assert run(folder, output)["a"].state == "not converged"
    before = {p: p.read_bytes() for p in (output / "campaigns" / "a").iterdir()}
    # Somebody else can write to the folder of the workers.
    os.chmod(tmp_path / "scratch", 0o777)
    row = run(folder, output, retry=("not-converged",))["a"]
    assert row.state == "failed"
    assert "its worker has no folder of its own" in row.outcome.sentence
    assert {p: p.read_bytes() for p in (output / "campaigns" / "a").iterdir()} == before
    # It is no property of the campaign: the next run tries it again, from where it was.
    os.chmod(tmp_path / "scratch", 0o700)
    assert run(folder, output, retry=("not-converged",))["a"].state == "not converged"
    assert starts(output, "a") == 2


def test_results_that_were_set_aside_come_back(tmp_path: Path, cluster: Here) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="done"), tmp_path / "out"
    run(folder, output)
    place = output / "campaigns" / "a"
    # Killed between the two steps of a replacement.
    place.rename(place.with_name(".writing-a.old"))
    assert run(folder, output)["a"].state == "done"
    assert starts(output, "a") == 1
    assert sorted(p.name for p in (output / "campaigns").iterdir()) == ["a"]


def test_damaged_results_replace_nothing(tmp_path: Path, cluster: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="not-converged"), tmp_path / "out"
    run(folder, output)
    kept_text = (output / "campaigns/a/result.json").read_text()

    def damaged(given: Task, campaign: bytes, results: bytes):
        outcome, content = run_elsewhere(given, campaign, results)
        return replace(outcome, result_sha256="0" * 64), content

    monkeypatch.setattr(sent_files, "run_elsewhere", damaged)
    row = run(folder, output, retry=("not-converged",))["a"]
    assert (row.state, row.outcome.sentence) == ("failed", "its results arrived damaged; run the fleet again")
    assert (output / "campaigns/a/result.json").read_text() == kept_text


def test_a_failure_on_the_way_is_tried_again_and_a_rejection_is_not(tmp_path: Path, cluster: Here, monkeypatch) -> None:
    folder, output = write_campaigns(tmp_path / "fleet", a="done", b="rejected No."), tmp_path / "out"

    def in_use(given: Task, campaign: bytes, results: bytes):
        outcome, content = run_elsewhere(given, campaign, results)
        return (Outcome("failed", "Another process is writing there.") if given.name == "a" else outcome), content

    with monkeypatch.context() as patch:
        patch.setattr(sent_files, "run_elsewhere", in_use)
        assert [row.state for row in run(folder, output).values()] == ["failed", "rejected"]
    assert [row.state for row in run(folder, output).values()] == ["done", "rejected"]
    assert starts(output, "b") == 1


def test_two_tasks_never_share_a_folder(tmp_path: Path) -> None:
    folder = write_campaigns(tmp_path / "fleet", a="done") / "a"
    given = Task("a", str(folder), str(tmp_path / "out"), command=COMMAND)
    campaign = packed(folder, campaign_files(folder))
    with sent_files._own_folder(given, campaign) as first:
        with sent_files._own_folder(given, campaign) as second:
            assert second != first
            assert second.is_dir()
        other = replace(given, choices={"seed": 1})
        with sent_files._own_folder(other, campaign) as third:
            assert third not in (first, second)
    # What a worker left that died is found by the next one: unfinished copies of results are not taken for results.
    with sent_files._own_folder(given, campaign) as again:
        assert again == first
        (again / "output.part").mkdir()
    outcome, content = run_elsewhere(given, campaign, packed(Path(), ()))
    assert outcome.state == "done"
    with zipfile.ZipFile(BytesIO(content)) as archive:
        assert "result.json" in archive.namelist()
    assert not first.exists()


def test_the_command_of_a_task_is_that_of_the_machine_it_runs_on() -> None:
    assert Task("a", "b", "c").command == ()
    assert task._CHILD[1:] == ("-m", "sysid.fleet.child")


class Remote:
    """A future of Dask's that has ended."""

    def __init__(self, status: str, error: BaseException | None = None):
        self.status, self._error = status, error

    def add_done_callback(self, callback) -> None:
        callback(self)

    def exception(self, timeout: float) -> BaseException | None:
        return self._error

    def result(self, timeout: float) -> str:
        if self._error is not None:
            raise self._error
        return "its result"


class Client:
    """A client of Dask's whose task ends at once."""

    def __init__(self, ended: Remote | None):
        self._ended = ended

    def submit(self, fn, *args, pure: bool) -> Remote:
        assert not pure
        if self._ended is None:
            raise OSError("the client is closed")
        return self._ended

    def nthreads(self) -> dict[str, int]:
        if self._ended is None:
            raise OSError("the client is closed")
        return {"a": 2, "b": 1}


@pytest.mark.parametrize(
    ("ended", "error"),
    [
        (Remote("finished"), None),
        (Remote("error", KeyError("x")), KeyError),
        (Remote("cancelled"), CancelledError),
        (Remote("lost"), CancelledError),
        # The scheduler goes while the result is fetched.
        (Remote("finished", OSError("connection closed")), CancelledError),
        (Remote("finished", asyncio.CancelledError()), CancelledError),
        (None, CancelledError),
    ],
)
def test_every_future_of_a_cluster_comes_to_an_end(ended: Remote | None, error: type[BaseException] | None) -> None:
    workers = ClusterWorkers(Client(ended))
    future = workers.submit(len, "x")
    assert future.done()
    if error is None:
        assert future.result() == "its result"
    else:
        with pytest.raises(error):
            future.result()
    assert workers.size() == (0 if ended is None else 3)


def test_lost_tasks_are_given_to_the_next_scheduler(tmp_path: Path, cluster: Here) -> None:
    cluster.lost = 2
    folder, output = write_campaigns(tmp_path / "fleet", a="done", b="done", c="done"), tmp_path / "out"
    assert {row.state for row in run(folder, output).values()} == {"done"}
    assert [starts(output, name) for name in "abc"] == [1, 1, 1]


def test_a_scheduler_that_is_always_lost_is_given_up(tmp_path: Path, cluster: Here) -> None:
    cluster.lost = 1000
    folder, output = write_campaigns(tmp_path / "fleet", a="done"), tmp_path / "out"
    with pytest.raises(OutputError, match="was lost 3 times before a campaign ended"):
        run(folder, output)


def test_a_scheduler_without_workers_is_given_up(tmp_path: Path, cluster: Here, monkeypatch) -> None:
    monkeypatch.setattr(running, "LOST_S", 1.0)
    cluster.workers = 0
    folder = write_campaigns(tmp_path / "fleet", a="done")
    with pytest.raises(OutputError, match="has no workers"):
        run(folder, tmp_path / "out")


def test_a_folder_in_use_is_no_property_of_its_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from sysid.fleet import child

    monkeypatch.setattr(child, "_PATIENCE_S", 0.5)
    folder, output = write_campaigns(tmp_path / "fleet", a="done"), tmp_path / "out"
    with FolderLock(output):
        outcome = child.calibrate(folder / "a", output, {}, lambda message, fraction: None)
    assert outcome.state == "failed"
    assert "Another process" in outcome.sentence
    assert outcome.key == "", "the next run would take it over"


def test_results_are_sent_without_locks_and_links(tmp_path: Path) -> None:
    for name in ("result.json", "stages/fit.npz", ".lock", ".writing-x"):
        (tmp_path / "out" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "out" / name).write_text("x")
    (tmp_path / "out" / "link").symlink_to("/etc/passwd")
    assert result_files(tmp_path / "out") == ["result.json", "stages/fit.npz"]
    assert result_files(tmp_path / "none") == []
    assert read_outcome(tmp_path / "none") is None
