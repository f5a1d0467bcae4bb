"""The same code on a Dask cluster: two workers give what this machine gives, and a killed worker loses nothing."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from fleet_child import COMMAND, DIGEST, write_campaigns

from sysid.errors import OutputError
from sysid.fleet import key
from sysid.fleet.read import read_fleet
from sysid.fleet.running import RunOptions, run_fleet

SUPPORT = Path(__file__).resolve().parents[1] / "support"

#: Dask warns of much that does not matter here; it gets a process of its own.
CLUSTER = """
import json, os, signal, sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from fleet_child import COMMAND, DIGEST
from sysid.fleet import key
from sysid.fleet.read import read_fleet
from sysid.fleet.running import RunOptions, run_fleet

def same_program():
    key.program_digest = lambda: DIGEST

def workers_of(cluster):
    return [w["pid"] for w in cluster.scheduler_info["workers"].values() if "pid" in w]

if __name__ == "__main__":
    import dask
    from distributed import Client, LocalCluster
    dask.config.set({"distributed.comm.timeouts.connect": "30s"})
    same_program()
    kill = sys.argv[4] == "kill"
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        with Client(cluster) as client:
            client.run(same_program)
            client.register_worker_callbacks(same_program)
            processes = client.run(os.getpid)
        killed = []
        def watch(rows):
            waiting = Path(sys.argv[3]) / "campaigns" / "a" / "fleet_progress.json"
            if kill and not killed and waiting.exists():
                child = int((waiting.parent / "starts").read_text().split()[0])
                parent = int(Path(f"/proc/{child}/stat").read_text().split()[3])
                killed.append(parent)
                os.kill(parent, signal.SIGKILL)
        options = RunOptions(2, cluster.scheduler_address, sys.argv[4] == "send", command=COMMAND)
        rows = run_fleet(read_fleet(Path(sys.argv[2])), Path(sys.argv[3]), options, watch)
    print(json.dumps({"killed": len(killed), "rows": {r.campaign: [r.state, r.outcome.result_sha256] for r in rows}}))
"""


def on_cluster(folder: Path, output: Path, script: Path, what: str = "-", code: str = CLUSTER) -> dict:
    # A file, not -c: its workers import it.
    script.write_text(code)
    words = [sys.executable, str(script), str(SUPPORT), str(folder), str(output), what]
    # The workers' own folders.
    environment = os.environ | {"TMPDIR": str(script.parent)}
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_two_workers_give_what_this_machine_gives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(key, "program_digest", lambda: DIGEST)
    monkeypatch.setenv("SYSID_THREADS", "1")
    folder = write_campaigns(tmp_path / "fleet", a="done", b="not-converged", c="rejected No.", d="die", e="done")
    found = on_cluster(folder, tmp_path / "cluster", tmp_path / "script.py")["rows"]
    rows = run_fleet(read_fleet(folder), tmp_path / "local", RunOptions(2, command=COMMAND), lambda rows: None)
    assert found == {row.campaign: [row.state, row.outcome.result_sha256] for row in rows}
    assert [found[n][0] for n in "abcde"] == ["done", "not converged", "rejected", "crashed", "done"]


def test_workers_that_do_not_see_the_folders_give_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(key, "program_digest", lambda: DIGEST)
    monkeypatch.setenv("SYSID_THREADS", "1")
    folder = write_campaigns(tmp_path / "fleet", a="done", b="not-converged", c="rejected No.", d="die", e="done")
    found = on_cluster(folder, tmp_path / "cluster", tmp_path / "script.py", "send")["rows"]
    rows = run_fleet(read_fleet(folder), tmp_path / "local", RunOptions(2, command=COMMAND), lambda rows: None)
    assert found == {row.campaign: [row.state, row.outcome.result_sha256] for row in rows}
    for name in "abcde":
        where = Path((tmp_path / "cluster/campaigns" / name / "where").read_text())
        assert where.is_relative_to(tmp_path)
        assert not where.is_relative_to(folder)
        assert not where.exists(), "a worker left files behind"
    # What is finished is found by its hash on this side, and is not sent again; nor is what was rejected.
    again = run_fleet(read_fleet(folder), tmp_path / "cluster", RunOptions(2, command=COMMAND), lambda rows: None)
    assert {row.campaign: [row.state, row.outcome.result_sha256] for row in again} == found
    starts = {n: len((tmp_path / "cluster/campaigns" / n / "starts").read_text().splitlines()) for n in "abcde"}
    assert starts == {"a": 1, "b": 1, "c": 1, "d": 2, "e": 1}


#: A scheduler and a worker are killed while two campaigns run, and started again.
RESTARTED = """
import json, socket, subprocess, sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from fleet_child import COMMAND, DIGEST
from sysid.fleet import key
from sysid.fleet.read import read_fleet
from sysid.fleet.running import RunOptions, run_fleet

def cluster(port):
    words = ["--no-dashboard", "--host", "127.0.0.1"]
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", str(port), *words]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}", "--nthreads", "1"]
    preload = ["--preload", str(Path(sys.argv[0]).parent / "preload.py"), "--nworkers", "2"]
    return [subprocess.Popen(w, stderr=subprocess.DEVNULL) for w in (scheduler, [*worker, *words, *preload])]

if __name__ == "__main__":
    key.program_digest = lambda: DIGEST
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    started = [cluster(port)]
    out = Path(sys.argv[3])

    def watch(rows):
        waits = all((out / "campaigns" / n / "starts").exists() for n in "ab")
        if waits and rows[0].state == "done" and len(started) == 1:
            for process in started[0]:
                process.kill() if process is started[0][0] else process.terminate()
            started.append(cluster(port))

    try:
        options = RunOptions(2, f"tcp://127.0.0.1:{port}", command=COMMAND)
        rows = run_fleet(read_fleet(Path(sys.argv[2])), out, options, watch)
    finally:
        for process in started[-1]:
            process.terminate()
    print(json.dumps({"killed": len(started) - 1, "rows": {r.campaign: [r.state, r.outcome.attempts] for r in rows}}))
"""


def test_a_scheduler_that_is_started_again_loses_nothing(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    folder = write_campaigns(tmp_path / "fleet", a="wait-once 60", b="wait-once 60", c="done", d="done")
    (tmp_path / "preload.py").write_text(f"from sysid.fleet import key\nkey.program_digest = lambda: {DIGEST!r}\n")
    # Before the two that wait.
    (folder / "c").rename(folder / "0c")
    found = on_cluster(folder, tmp_path / "out", tmp_path / "script.py", code=RESTARTED)
    assert found["killed"] == 1
    assert {state for state, _ in found["rows"].values()} == {"done"}
    starts = {p.name: len((p / "starts").read_text().splitlines()) for p in (tmp_path / "out/campaigns").iterdir()}
    assert starts == {"0c": 1, "a": 2, "b": 2, "d": 1}


def test_a_killed_worker_loses_nothing(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    folder = write_campaigns(tmp_path / "fleet", a="wait-once 60", b="done", c="done")
    found = on_cluster(folder, tmp_path / "out", tmp_path / "script.py", "kill")
    assert found["killed"] == 1
    assert {state for state, _ in found["rows"].values()} == {"done"}
    starts = {n: len((tmp_path / "out/campaigns" / n / "starts").read_text().splitlines()) for n in "abc"}
    assert starts == {"a": 2, "b": 1, "c": 1}


def test_a_scheduler_that_does_not_answer_is_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    code = (
        "import sys; from pathlib import Path\n"
        "from sysid.errors import OutputError\n"
        "from sysid.fleet.executors import cluster_executor\n"
        "try:\n"
        "    with cluster_executor('tcp://127.0.0.1:9'): pass\n"
        "except OutputError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.startswith("No Dask scheduler answers at tcp://127.0.0.1:9")
    assert OutputError.exit_code == 3


#: A scheduler that takes encrypted connections by one certificate only, and what this program hears of it.
ENCRYPTED = """
import json, os, sys
from sysid.errors import OutputError
from sysid.fleet.executors import cluster_executor

if __name__ == "__main__":
    import dask
    from distributed import LocalCluster
    from distributed.security import Security
    files = {f"tls_{who}_{what}": sys.argv[1 if what == "cert" else 2]
             for who in ("client", "scheduler", "worker") for what in ("cert", "key")}
    security = Security(tls_ca_file=sys.argv[1], require_encryption=True, **files)
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, protocol="tls", security=security,
                      dashboard_address=None) as cluster:
        said = [cluster.scheduler_address.split(":")[0]]
        for known in (True, False):
            if not known:
                dask.config.set({"distributed.comm.tls.ca-file": None, "distributed.comm.tls.client.cert": None})
            try:
                with cluster_executor(cluster.scheduler_address) as executor:
                    said.append(executor.submit(abs, -3).result(30))
            except OutputError as error:
                said.append(str(error))
    print(json.dumps(said))
"""


def test_a_scheduler_by_tls_needs_its_certificate(tmp_path: Path) -> None:
    """As the page on fleets says: certificates by the variables of Dask."""
    pytest.importorskip("distributed")
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("no openssl to make a certificate")
    certificate, secret = tmp_path / "certificate.pem", tmp_path / "key.pem"
    made = ["req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost"]
    subprocess.run([openssl, *made, "-keyout", secret, "-out", certificate], check=True, capture_output=True)
    names = {"CA_FILE": certificate, "CLIENT__CERT": certificate, "CLIENT__KEY": secret}
    environment = os.environ | {f"DASK_DISTRIBUTED__COMM__TLS__{name}": str(file) for name, file in names.items()}
    script = tmp_path / "script.py"
    script.write_text(ENCRYPTED)
    words = [sys.executable, str(script), str(certificate), str(secret)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    protocol, answer, refused = json.loads(done.stdout.splitlines()[-1])
    assert (protocol, answer) == ("tls", 3)
    assert refused.startswith("No Dask scheduler answers at tls://")
    assert refused.endswith("check the address and the certificates of Dask.")
