"""``fleet.toml``: what it means, what is refused in one sentence, and how it is begun; the commands on it."""

from __future__ import annotations

import errno
import os
import shlex
import sys
import unicodedata
from pathlib import Path

import pytest
from click.testing import CliRunner

from sysid.cli.fleet import fleet
from sysid.cli.main import cli
from sysid.errors import CampaignError
from sysid.fleet.begin import fleet_text
from sysid.fleet.read import read_fleet, result_name

FLEET = """\
schema = 1
[fleet]
title = "Mine"
[[truck]]
name = "A 1"
type = "rigid3"
campaign = [{ folder = "a/may", date = 2026-05-01 }, { folder = "a/june", name = "again" }]
[[truck]]
name = "B"
campaign = [{ folder = "b" }]
[[shared]]
name = "scales"
log_sd = 0.01
moves = { stiffness = 1.0, damping = 1.0 }
campaigns = ["again", "b"]
"""
SCALES = '[[shared]]\nname = "scales"\nlog_sd = 0.02\nmoves = { stiffness = 1.0 }\n'


def write(folder: Path, text: str = FLEET) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fleet.toml").write_text(text, encoding="utf-8")
    return folder


def test_a_fleet_is_what_its_file_says(tmp_path: Path) -> None:
    fleet = read_fleet(write(tmp_path / "f"))
    assert [(t.name, t.type, [c.name for c in t.campaigns]) for t in fleet.trucks] == [
        ("A 1", "rigid3", ["a-may", "again"]),
        ("B", "truck", ["b"]),
    ]
    assert fleet.trucks[0].campaigns[0].date == "2026-05-01"
    assert fleet.trucks[0].campaigns[0].folder == tmp_path / "f" / "a" / "may"
    assert fleet.shared[0].campaigns == ("again", "b")
    assert fleet.count == 3


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("schema = 1", "schema = 2", "schema"),
        ('name = "B"', 'name = "A 1"', "two trucks have the name 'A 1'"),
        ('name = "B"', 'name = "A\\u200e 1"', "two trucks have the name 'A 1'"),
        ('name = "B"', 'name = "A 1\\u200d"', "two trucks have the name 'A 1'"),
        ('name = "again"', 'name = "B"', "two campaigns have the name 'b'"),
        ('folder = "b"', 'folder = "a//may/.", name = "b"', "the campaigns 'a-may' and 'b' have one folder"),
        ("[[shared]]", SCALES + "[[shared]]", "two shared errors have the name 'scales'"),
        ('folder = "b"', 'folder = "../b"', "leads outside the campaign folder"),
        ('folder = "b"', 'folder = "/etc"', "an absolute path"),
        ('name = "again"', 'name = "a/b"', "a folder gets this name"),
        ('name = "again"', 'name = ".."', "a folder gets this name"),
        ('"again", "b"', '"agian", "b"', "did you mean 'again'"),
        ('type = "rigid3"', 'kind = "rigid3"', "is not a known key"),
        ("log_sd = 0.01", "log_sd = -1", "log_sd"),
        ("{ stiffness", "{ stifness", "stifness"),
        ('[{ folder = "b" }]', "[]", "campaign"),
        ('title = "Mine"', 'title = "TODO: name it"', "to fill in"),
        ("[fleet]", "[fleet", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in FLEET
    with pytest.raises(CampaignError) as error:
        read_fleet(write(tmp_path, FLEET.replace(old, new, 1)))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_one_folder_by_two_names_is_refused_and_two_folders_with_one_file_are_not(tmp_path: Path) -> None:
    folder = write(tmp_path, FLEET.replace('["again", "b"]', '["b"]').replace("a/june", "a/june/campaign.toml"))
    (folder / "a" / "may").mkdir(parents=True)
    (folder / "a" / "june").mkdir()
    (folder / "a" / "may" / "campaign.toml").write_text("")
    (folder / "a" / "june" / "campaign.toml").symlink_to("../may/campaign.toml")
    (folder / "b").symlink_to("a/other")
    assert read_fleet(folder).count == 3
    (folder / "b").unlink()
    (folder / "b").symlink_to("a/june")
    result = CliRunner().invoke(cli, ["fleet", "status", str(folder), "--output", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "fleet.toml: the campaigns 'again' and 'b' have one folder" in result.stderr


def test_a_folder_of_campaigns_is_a_fleet_too(tmp_path: Path) -> None:
    for name in ("x/one", "x/two", "y"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "campaign.toml").write_text('[vehicle]\nname = "rigid"\n')
    assert [c.name for _, c in read_fleet(tmp_path).campaigns()] == ["x-one", "x-two", "y"]
    # Begun as a file, campaigns in one folder are of one truck.
    text, said = fleet_text(tmp_path)
    assert said == []
    (tmp_path / "fleet.toml").write_text(text)
    begun = read_fleet(tmp_path)
    assert [(t.name, t.type, len(t.campaigns)) for t in begun.trucks] == [("x", "rigid", 2), ("y", "rigid", 1)]
    (tmp_path / "empty").mkdir()
    with pytest.raises(CampaignError, match=r"neither a fleet\.toml nor subfolders"):
        read_fleet(tmp_path / "empty")
    with pytest.raises(CampaignError, match="There is no fleet file"):
        read_fleet(tmp_path / "none.toml")
    assert result_name("a b/ü.c") == "a-b-ü.c"


def campaign_at(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "campaign.toml").write_text('[vehicle]\nname = "rigid"\n')
    return folder


def links(folder: Path, outside: Path) -> list[str]:
    """A folder of two trucks, one of them a link, and of what is left out: sentences about that."""
    campaign_at(folder / "T1" / "may")
    campaign_at(outside / "T2" / "june")
    (folder / "T2").symlink_to(outside / "T2")
    (folder / "A1").symlink_to("T1/may")
    (folder / "loop").symlink_to(".")
    (folder / "up").symlink_to("../..")
    (outside / "T2" / "back").symlink_to(folder / "T1")
    (outside / "T2" / "again").symlink_to(".")
    (folder / "lost").symlink_to("not mounted")
    campaign_at(folder / "T1" / ".old")
    campaign_at(folder / "T1" / "may" / "copy")
    campaign_at(folder / "a" / "b" / "c" / "d" / "e")
    return [
        "lost is a link to nothing; restore what it leads to, or remove it.",
        "T1/.old is left out: its name begins with a dot.",
        "T1/may/copy is left out: it is inside of another campaign.",
        "a/b/c/d/e is left out: it is more than 4 folders deep.",
        "A1 is left out: the link leads to T1/may.",
        "loop is left out: the link leads back to the folder of the fleet, or above it.",
        "up is left out: the link leads back to the folder of the fleet, or above it.",
        "T2/again is left out: the link leads to T2.",
        "T2/back is left out: the link leads to T1.",
    ]


def test_links_to_folders_are_followed_and_every_folder_is_taken_once(tmp_path: Path) -> None:
    said = links(tmp_path / "fleet", tmp_path / "disk")
    fleet = read_fleet(tmp_path / "fleet")
    assert [c.name for _, c in fleet.campaigns()] == ["T1-may", "T2-june"]
    assert sorted(fleet.messages) == sorted(said)
    output = ["--output", str(tmp_path / "out")]
    for words in (["status", *output], ["jobs", *output], ["init"]):
        result = CliRunner().invoke(cli, ["fleet", words[0], str(tmp_path / "fleet"), *words[1:]])
        assert result.exit_code == 0
        assert all(sentence in result.stderr.replace("\n", " ") for sentence in said)
    assert [[c.name for c in t.campaigns] for t in read_fleet(tmp_path / "fleet").trucks] == [["T1-may"], ["T2-june"]]


@pytest.mark.skipif(sys.platform != "linux", reason="names are UTF-8 on other systems")
def test_a_name_that_is_not_text_is_said(tmp_path: Path) -> None:
    odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xfcber"))
    campaign_at(odd / "may")
    with pytest.raises(CampaignError, match="its name is not UTF-8; rename it"):
        read_fleet(tmp_path)
    campaign_at(tmp_path / "T1")
    fleet = read_fleet(tmp_path)
    assert [c.name for _, c in fleet.campaigns()] == ["T1"]
    assert fleet.messages == (r"\udcfcber/may is left out: its name is not UTF-8; rename it.",)


def test_a_folder_that_cannot_be_read_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign_at(tmp_path / "T1")
    locked, listed = campaign_at(tmp_path / "T2" / "may").parent, os.scandir

    def refuses(path):
        if Path(path) == locked:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return listed(path)

    monkeypatch.setattr(os, "scandir", refuses)
    assert read_fleet(tmp_path).messages == ("T2 cannot be read (Permission denied); look at its rights.",)


def test_init_never_writes_over_a_file_unless_told(tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "campaign.toml").write_text("")
    run = CliRunner().invoke
    assert run(cli, ["fleet", "init", str(tmp_path)]).exit_code == 0
    (tmp_path / "fleet.toml").write_text("mine")
    refused = run(cli, ["fleet", "init", str(tmp_path)])
    assert refused.exit_code == 2
    assert "give --force" in refused.stderr
    assert (tmp_path / "fleet.toml").read_text() == "mine"
    assert run(cli, ["fleet", "init", str(tmp_path), "--force"]).exit_code == 0
    assert run(cli, ["fleet", "init", str(tmp_path / "none")]).exit_code == 2


def test_the_name_of_the_command_run_may_be_left_out(tmp_path: Path) -> None:
    for words in (["fleet", str(tmp_path)], ["fleet", "run", str(tmp_path)], ["fleet", "--quick", str(tmp_path)]):
        result = CliRunner().invoke(cli, words)
        assert result.exit_code == 2
        assert "neither a fleet.toml nor subfolders" in result.stderr


def test_jobs_are_one_command_per_campaign_that_means_the_same(tmp_path: Path) -> None:
    folder = write(tmp_path / "my fleet")
    output = str(tmp_path / "out")
    result = CliRunner().invoke(cli, ["fleet", "jobs", str(folder), "--output", output, "--quick", "--seed", "3"])
    lines = [shlex.split(line) for line in result.stdout.splitlines()]
    assert len(lines) == 3
    begin = lines[1].index("run")
    parsed = fleet.commands["run"].make_context("run", lines[1][begin + 1 :]).params
    assert parsed["path"] == folder
    assert parsed["only"] == ("again",)
    assert (parsed["quick"], parsed["seed"], parsed["workers"]) == (True, 3, 1)


def test_jobs_name_their_folders_to_the_letter_or_say_that_they_cannot(tmp_path: Path) -> None:
    """Persian words have joiners that are not seen; a mark of direction is no part of any word."""
    folder = tmp_path / "\u0646\u0645\u06cc\u200c\u062f\u0627\u0646\u0645"
    write(folder)
    words = ["--output", str(tmp_path / "out")]
    result = CliRunner().invoke(cli, ["fleet", "jobs", str(folder), *words])
    assert [Path(shlex.split(line)[4]) for line in result.stdout.splitlines()] == [folder] * 3
    for sign in ("\u202e", "\n", "\x1b[31m"):
        folder.rename(folder := tmp_path / f"a{sign}b")
        result = CliRunner().invoke(cli, ["fleet", "jobs", str(folder), *words])
        assert (result.exit_code, result.stdout) == (2, "")
        assert "rename the folder" in result.stderr
        assert sign not in result.stderr.strip()


def test_status_computes_nothing(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["fleet", "status", str(write(tmp_path / "f")), "--output", str(tmp_path / "out")])
    assert result.exit_code == 0
    assert "Campaigns: 3 queued." in result.stdout
    assert not (tmp_path / "out").exists()


def test_without_a_cluster_its_absence_is_one_sentence(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "campaign.toml").write_text("")
    monkeypatch.setitem(sys.modules, "distributed", None)
    words = ["fleet", str(tmp_path), "--output", str(tmp_path / "out"), "--scheduler", "tcp://127.0.0.1:1"]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 2
    assert "pip install 'truck-sysid[cluster]'" in result.stderr


NAMES_OF_FOLDERS = (
    "Грузовик 1",
    "Грузовик 2",
    "卡车",
    "貨車",
    "شاحنة",
    "गाड़ी",
    "नमी\u200dकरण",
    "نمی\u200cدانم",
    "نمیدانم",
    "Łódź",
    "a b",
    "a-b",
    "A-B",
    "😀",
    "🚚",
)


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_folders_of_any_script_give_a_file_that_can_be_read(tmp_path: Path, form: str) -> None:
    for name in NAMES_OF_FOLDERS:
        campaign_at(tmp_path / unicodedata.normalize(form, name))
    (tmp_path / "fleet.toml").write_text(fleet_text(tmp_path)[0], encoding="utf-8")
    names = [c.name for _, c in read_fleet(tmp_path).campaigns()]
    assert len({n.casefold() for n in names}) == len(NAMES_OF_FOLDERS)
    assert {"Грузовик-1", "Грузовик-2", "卡车", "貨車", "شاحنة", "Łódź", "نمی\u200cدانم"} <= set(names)
    assert all(len(n.encode()) <= 120 for n in names)


def test_long_names_stay_distinct_and_short(tmp_path: Path) -> None:
    for end in ("一", "二"):
        campaign_at(tmp_path / ("車" * 60 + end))
    (tmp_path / "fleet.toml").write_text(fleet_text(tmp_path)[0], encoding="utf-8")
    names = [c.name for _, c in read_fleet(tmp_path).campaigns()]
    assert len(set(names)) == 2
    assert max(len(n.encode()) for n in names) <= 120
