"""Full disk, read-only folder, two writers, a reader beside the writer: one sentence each, and nothing lost."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from threading import Thread

import killed_chain
import numpy as np
import pytest
from killed_chain import CENTRE, COVARIANCE, NAMES, OPTIONS

from sysid import files
from sysid.errors import DataRejectedError, OutputError
from sysid.folder_lock import FolderLock
from sysid.posterior.checkpoint import read_chain
from sysid.posterior.sampling import chain_identity, posterior_so_far

SUPPORT = Path(killed_chain.__file__).parent
HOLD = """
import sys, time
from pathlib import Path
from sysid.folder_lock import FolderLock
with FolderLock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""
#: Samples into a folder and says how it went.
TRY = """
import sys
from pathlib import Path
from killed_chain import sample
from sysid.errors import OutputError
try:
    sample(Path(sys.argv[1]), resume=True)
except OutputError as error:
    print(error)
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """Folder and draws of the run that nothing disturbs."""
    folder = tmp_path_factory.mktemp("whole") / "chain"
    return folder, killed_chain.sample(folder).draws.tobytes()


def private_mount(folder: Path, options: str, command: str) -> str:
    """Output of a shell command that sees a small file system of its own at `folder`; skips where that is forbidden."""
    if shutil.which("unshare") is None:
        pytest.skip("needs unshare")
    mount = f"mount -t tmpfs -o {options} none '{folder}'"
    if subprocess.run(["unshare", "-rm", "sh", "-c", mount], capture_output=True).returncode != 0:
        pytest.skip("file systems of one's own are forbidden here")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([os.getcwd(), str(SUPPORT)])}
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", f"{mount} && {command}"], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout.strip()


def test_a_full_disk_is_one_sentence_and_the_chain_goes_on_elsewhere(whole, tmp_path):
    small, rescued = tmp_path / "small", tmp_path / "chain"
    small.mkdir()
    script = tmp_path / "try.py"
    script.write_text(TRY)
    said = private_mount(
        small, "size=120k", f"'{sys.executable}' '{script}' '{small}/chain' && cp -r '{small}/chain' '{rescued}'"
    )
    assert said == (
        "chain/ cannot be written (No space left on device); everything up to the last checkpoint is safe and --resume "
        "goes on from there; free some space or choose another folder with --output."
    )
    found = read_chain(rescued)
    assert found is not None
    assert 0 < len(found[1]) < OPTIONS.max_steps // OPTIONS.segment_steps
    assert killed_chain.sample(rescued, resume=True).draws.tobytes() == whole[1]


def test_a_read_only_folder_is_one_sentence(tmp_path):
    folder = tmp_path / "shut"
    folder.mkdir()
    script = tmp_path / "try.py"
    script.write_text(TRY)
    said = private_mount(folder, "ro", f"'{sys.executable}' '{script}' '{folder}/chain'")
    assert said.startswith("chain/ cannot be written (Read-only file system); ")
    assert "\n" not in said


@pytest.mark.parametrize("call", range(6))
def test_whichever_write_fails_first_nothing_is_lost(whole, tmp_path, monkeypatch, call: int):
    """Every write that waits for the disk fails once: segment, its folder, the next segment ..."""
    calls = iter(range(100_000))
    fsync = os.fsync

    def failing(handle: int) -> None:
        if next(calls) == call:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(handle)

    folder = tmp_path / "chain"
    monkeypatch.setattr(files.os, "fsync", failing)
    with pytest.raises(OutputError, match="No space left on device") as caught:
        killed_chain.sample(folder)
    assert (caught.value.exit_code, "\n" in str(caught.value)) == (DataRejectedError.exit_code, False)
    assert killed_chain.sample(folder, resume=True).draws.tobytes() == whole[1]


def test_one_writer_at_a_time_and_none_after_a_kill(whole, tmp_path):
    folder = tmp_path / "chain"
    shutil.copytree(whole[0], folder)
    with subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(OutputError, match="Another process is writing to chain/") as caught:
            killed_chain.sample(folder, resume=True)
        assert "\n" not in str(caught.value)
        holder.send_signal(getattr(signal, "SIGKILL", signal.SIGTERM))
        holder.wait()
    assert (folder / ".lock").exists()
    assert killed_chain.sample(folder, resume=True).draws.tobytes() == whole[1]


def test_the_right_to_write_may_be_taken_again_by_its_owner_only(tmp_path):
    mine, other = FolderLock(tmp_path), FolderLock(tmp_path)
    with mine:
        with mine:
            pass
        with pytest.raises(OutputError), other:
            pass
    with other:
        pass


def test_a_reader_beside_the_writer_sees_the_first_draws_of_the_chain(whole, tmp_path):
    folder = tmp_path / "chain"
    writer = Thread(target=killed_chain.sample, args=(folder,))
    writer.start()
    seen = []
    while writer.is_alive():
        found = read_chain(folder)
        if found is not None:
            seen.append(found[1])
    writer.join()
    final = read_chain(whole[0])
    assert final is not None
    counts = [len(segments) for segments in seen]
    assert counts == sorted(counts)
    assert len(set(counts)) > 3
    for segments in seen[:: max(1, len(seen) // 20)]:
        for one, other in zip(segments, final[1], strict=False):
            np.testing.assert_array_equal(one.draws, other.draws)


def test_what_there_is_so_far_is_a_posterior_that_has_not_converged(whole):
    identity = chain_identity(OPTIONS, CENTRE, COVARIANCE, {})
    found = posterior_so_far(whole[0], identity, NAMES, "test", OPTIONS)
    assert found is not None
    assert found.draws.tobytes() == whole[1]
    assert not found.converged
    assert found.message.startswith("Sampling has not finished.")
    assert posterior_so_far(whole[0], identity | {"file a": "b"}, NAMES, "test", OPTIONS) is None
    assert posterior_so_far(whole[0] / "nowhere", identity, NAMES, "test", OPTIONS) is None
