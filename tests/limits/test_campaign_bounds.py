"""Campaign files and names in them that would cost gigabytes, hang, or lead out of the folder."""

from __future__ import annotations

import hashlib
import os
import threading
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid import limits
from sysid.campaign import Sensor, read_campaign, read_log
from sysid.campaign.toml.bounds import check_bounds
from sysid.errors import CampaignError, DataRejectedError
from sysid.logs.input_file import FileRefusedError, InputFile, read_file, read_file_inside

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"

BOUNDS = {
    "dotted key": (".".join(["a"] * 20_000) + " = 1", "line 1, has a key with more than 8 parts"),
    "dotted key with space and quotes": (' . '.join(["a", '"b.c"', "'d'"] * 4) + " = 1", "more than 8 parts"),
    "dotted table": ("x = 1\n[" + ".".join(["a"] * 20_000) + "]", "line 2, has a key with more than 8 parts"),
    "dotted key in a table": ("x = { " + ".".join(["a"] * 9) + " = 1 }", "more than 8 parts"),
    "long key": ("a" * 2_000 + " = 1", "more than 1000 characters"),
    "long number": ("a = 1" + "0" * 2_000, "more than 1000 characters"),
    "nested lists": ("a = " + "[" * 5_000 + "]" * 5_000, "nested too deeply"),
    "nested tables": ("a = " + "{ a = " * 100, "nested too deeply"),
    "many keys": ("\n".join(f"k{i} = 1" for i in range(limits.KEYS + 1)), "40001 keys"),
    "many tables": ("[a]\n" * (limits.KEYS + 1), "40001 tables"),
    "many entries": ("a = [" + "1," * (limits.LIST_ENTRIES + 1) + "]", "300001 entries"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "said"), BOUNDS.values(), ids=BOUNDS)
def test_what_no_campaign_needs_is_refused_before_it_is_parsed(text: str, said: str) -> None:
    with pytest.raises(CampaignError) as error:
        check_bounds(text, "campaign.toml")
    assert said in str(error.value)
    assert str(error.value).startswith("campaign.toml")
    assert "\n" not in str(error.value)


ALLOWED = {
    "dots in text": 'notes = "a.b.c.d.e.f.g.h.i.j.k.l.m"',
    "dots in a literal": "notes = 'a.b.c.d.e.f.g.h.i.j.k.l.m'",
    "dots in a comment": "x = 1 # a.b.c.d.e.f.g.h.i.j.k.l.m",
    "brackets in text": 'notes = "' + "[" * 100 + '"',
    "text of many lines": 'notes = """' + "[[[\n" * 50 + '\\""" a.b.c.d.e.f.g.h.i.j.k""""\nx = 1',
    "escaped marks": r'notes = "\\\"a.b.c.d.e.f.g.h.i.j.k.l"',
    "empty text": "a = ''\nb = \"\"\nc = ''''''\nd = [['a'], ['b']]",
    "eight parts": ".".join("abcdefgh") + " = 1",
    "numbers": "a = [" + "1.5, " * 1000 + "]",
}


@pytest.mark.parametrize("text", ALLOWED.values(), ids=ALLOWED)
def test_what_the_parser_reads_easily_passes(text: str) -> None:
    tomllib.loads(text)
    check_bounds(text, "campaign.toml")
    # No string hides what stands behind it.
    with pytest.raises(CampaignError, match="nested too deeply"):
        check_bounds(f"{text}\nz = {'[' * 40}{']' * 40}\n", "campaign.toml")


def test_many_missing_columns_with_long_names_take_no_time(tmp_path: Path) -> None:
    names = [f"{'x' * 150}{i:04d}" for i in range(1999)]
    sensors = [Sensor(f"{'x' * 150}_{i:04d}", "axle_acceleration", "g", axle=0) for i in range(999)]
    sensors.append(Sensor(names[0], "axle_acceleration", "g", axle=0))
    rows = "".join(f"{0.01 * i}{',1' * 1999}\n" for i in range(5))
    (tmp_path / "log.csv").write_text(f"time_s,{','.join(names)}\n{rows}", encoding="utf-8")
    begin = time.process_time()
    log = read_log(tmp_path / "log.csv", "log.csv", sensors, 0.01)
    assert time.process_time() - begin < 2.0
    assert len(log.messages) == 999


def test_the_linear_truck_is_far_below_the_bounds() -> None:
    text = (DATA / "campaign.toml").read_text(encoding="utf-8")
    check_bounds(text, "campaign.toml")
    assert 10 * text.count("=") < limits.KEYS


@settings(max_examples=300, derandomize=True, deadline=None)
@given(st.text(alphabet="ab\"'\\#\n =[]{}.,1", max_size=60))
def test_the_scan_of_strings_agrees_with_the_parser(text: str) -> None:
    """Where the parser accepts a text with more brackets than allowed outside strings, the scan has counted them."""
    check_bounds(text, "campaign.toml")
    deep = text + "\nz = " + "[" * (limits.NESTING + 1) + "]" * (limits.NESTING + 1)
    try:
        tomllib.loads(deep)
    except (tomllib.TOMLDecodeError, RecursionError):
        return
    with pytest.raises(CampaignError, match="nested too deeply"):
        check_bounds(deep, "campaign.toml")


@pytest.mark.parametrize("name", ["a\\u0007b.csv", "a\\u009bb.csv", "a\\u2028b.csv", "a\\tb.csv"])
def test_names_with_control_characters_are_refused(small: Callable[..., Path], name: str) -> None:
    with pytest.raises(CampaignError, match="control characters") as error:
        read_campaign(small(('"run.csv"', f'"{name}"')))
    assert str(error.value).isprintable()


def test_hash_and_data_come_from_the_same_bytes(small: Callable[..., Path]) -> None:
    """A reader that overwrites the file after it was read changes neither the hash nor the points."""
    file = small()
    before = (file.parent / "scan.csv").read_bytes()
    seen = []

    def reader(content: InputFile, unit: str):
        Path(content).write_bytes(b"something else")
        seen.append(content.data)
        return [[0.0, 0.0, 0.0]]

    campaign = read_campaign(file, point_cloud_reader=reader)
    assert seen == [before]
    assert campaign.input_sha256["scan.csv"] == hashlib.sha256(before).hexdigest()
    assert campaign.input_sha256["campaign.toml"] == hashlib.sha256(file.read_bytes()).hexdigest()


def test_a_file_that_two_tests_name_must_not_change_between_them(small: Callable[..., Path]) -> None:
    scans = '[scan.a]\nfile = "scan.csv"\nheading_deg = 0\n[scan.b]\nfile = "scan.csv"\nheading_deg = 5'
    file = small(('[scan]\nfile = "scan.csv"\nheading_deg = 90', scans))

    def reader(content: InputFile, unit: str):
        Path(content).write_bytes(content.data + b"1,1,1\n")
        return [[0.0, 0.0, 0.0]]

    with pytest.raises(DataRejectedError, match=r"scan.b.file names 'scan.csv', which changed while"):
        read_campaign(file, point_cloud_reader=reader)


def test_all_files_together_are_bounded(small: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    file = small()
    monkeypatch.setattr(limits, "INPUT_NUMBERS", 99)
    with pytest.raises(DataRejectedError, match="million numbers"):
        read_campaign(file)
    monkeypatch.setattr(limits, "INPUT_BYTES", 10)
    with pytest.raises(DataRejectedError, match="million bytes"):
        read_campaign(file)


def test_links_inside_the_folder_are_followed_and_no_others(tmp_path: Path) -> None:
    folder, outside = tmp_path / "campaign", tmp_path / "outside"
    for place in (folder / "logs", outside):
        place.mkdir(parents=True)
        (place / "a.csv").write_text(place.name)
    (folder / "link.csv").symlink_to("logs/a.csv")
    (folder / "linked").symlink_to("logs")
    for name in ("logs/a.csv", "link.csv", "linked/a.csv", "./logs/./a.csv"):
        assert read_file_inside(folder, name, 100).data == b"logs"
    (folder / "out.csv").symlink_to(outside / "a.csv")
    (folder / "away").symlink_to(outside)
    for name in ("out.csv", "away/a.csv", "../outside/a.csv"):
        with pytest.raises(FileRefusedError) as error:
            read_file_inside(folder, name, 100)
        assert error.value.kind == "link"


def test_a_link_put_there_while_the_path_is_walked_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The check says that the path is inside; what stands there when it is opened is a link out of the folder."""
    folder, outside = tmp_path / "campaign", tmp_path / "outside"
    outside.mkdir()
    (outside / "a.csv").write_text("secret")
    folder.mkdir()
    (folder / "logs").symlink_to(outside)
    resolve = Path.resolve
    monkeypatch.setattr(Path, "resolve", lambda self: self if self.name == "a.csv" else resolve(self))
    with pytest.raises(OSError, match=r"Not a directory|symbolic"):
        read_file_inside(folder, "logs/a.csv", 100)


@pytest.mark.parametrize("way", ["pipe", "device", "folder"])
def test_pipes_devices_and_folders_are_refused_unopened(tmp_path: Path, way: str) -> None:
    path = {"pipe": tmp_path / "pipe", "device": Path("/dev/zero"), "folder": tmp_path}[way]
    if way == "pipe":
        os.mkfifo(path)
    # Opening a pipe without a writer would never come back.
    found: list[str] = []

    def attempt() -> None:
        try:
            read_file(path, 1000)
        except FileRefusedError as error:
            found.append(error.kind)

    thread = threading.Thread(target=attempt, daemon=True)
    thread.start()
    thread.join(30.0)
    assert found == ["folder" if way == "folder" else "special"]


def test_a_file_that_grows_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"12345")
    status = os.stat(path)
    with path.open("ab") as stream:
        stream.write(b"6")
    monkeypatch.setattr(os, "fstat", lambda descriptor: status)
    with pytest.raises(FileRefusedError) as error:
        read_file(path, 1000)
    assert error.value.kind == "changed"
