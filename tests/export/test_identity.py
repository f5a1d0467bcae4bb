"""Which result a file is from: in the file where its format has a place, and in the list beside it."""

from __future__ import annotations

import hashlib
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest
from keyword_reader import read_deck
from small_results import small_results

from sysid.export.file_list import FILE_LIST, remember_files
from sysid.export.identity import Identity, content_sha256, identity_of, stamped
from sysid.export.result_json import result_document

IDENTITY = Identity("1234abcd5678", "ab" * 32, "2026-11-28T02:15:35+00:00", "cd" * 32)


def test_the_hash_is_that_of_the_content_without_times() -> None:
    """As anybody computes it from the file."""
    document = json.loads(json.dumps(result_document(small_results())))
    kept = {k: v for k, v in document.items() if k not in ("timings", "identity")}
    expected = hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()
    assert document["identity"]["content_sha256"] == content_sha256(document) == expected
    assert content_sha256({**document, "timings": {}, "identity": None}) == expected
    assert content_sha256({**document, "seed": 8}) != expected


def test_a_run_is_told_by_its_inputs_options_and_versions() -> None:
    base = small_results()
    runs = [
        identity_of(result_document(r)).run
        for r in (
            base,
            replace(base, warnings=("Another.",)),
            replace(base, provenance={**base.provenance, "seed": 99}),
            replace(base, provenance={**base.provenance, "input_sha256": {"campaign.toml": "0" * 64}}),
        )
    ]
    assert runs[0] == runs[1]
    assert len(set(runs)) == 3


def test_figures_have_it_as_their_description() -> None:
    svg = '<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg" width="3"><g/></svg>'
    text = stamped("figures/a.svg", svg, IDENTITY)
    root = ET.fromstring(text)
    assert root[0].tag.endswith("desc")
    own = hashlib.sha256(svg.encode()).hexdigest()
    assert root[0].text == f"{IDENTITY.line}, own sha256 {own}"
    # Anybody finds it again: without the element the file is what was hashed.
    assert re.sub("\n <desc>.*</desc>", "", text) == svg


def test_decks_have_it_as_comments_that_keep_their_columns() -> None:
    deck = "*KEYWORD\n$ Units\n*END\n"
    text = stamped("models/a/lsdyna.k", deck, IDENTITY)
    assert text.startswith("*KEYWORD\n$ ")
    assert {IDENTITY.result_sha256, IDENTITY.inputs_sha256} <= set(text.split())
    assert f"$ own sha256 {hashlib.sha256(deck.encode()).hexdigest()}" in text.splitlines()
    words = [*IDENTITY.line.split(", "), "own sha256"]
    assert (
        "".join(line for line in text.splitlines(True) if not line.startswith(tuple(f"$ {w}" for w in words))) == deck
    )
    assert max(map(len, text.splitlines())) <= 80
    read, plain = read_deck(text), read_deck(deck)
    assert read.comments[-1:] == plain.comments
    assert replace(read, comments=[]) == replace(plain, comments=[])


def test_patches_have_it_in_their_comment() -> None:
    patch = json.loads(stamped("a.json", json.dumps({"Comment": "Axle 1.", "Spring": {"Preload": 1.5}}), IDENTITY))
    own = hashlib.sha256(b'{"Spring": {"Preload": 1.5}}').hexdigest()
    comment = f"Axle 1. {IDENTITY.line}, own sha256 {own}."
    assert patch == {"Comment": comment, "Spring": {"Preload": 1.5}}


def test_tables_stay_as_they_are() -> None:
    assert stamped("a.csv", "time_s,a\n0,1\n", IDENTITY) == "time_s,a\n0,1\n"


def test_the_list_has_every_file_with_its_own_hash(tmp_path: Path) -> None:
    (tmp_path / "predictions").mkdir()
    paths = [tmp_path / "a.csv", tmp_path / "predictions" / "b.csv"]
    for path in paths:
        path.write_text(path.name, encoding="utf-8")
    remember_files(tmp_path, paths, IDENTITY)
    files = json.loads((tmp_path / FILE_LIST).read_text(encoding="utf-8"))["files"]
    about = {
        "run": IDENTITY.run,
        "date": IDENTITY.date,
        "inputs_sha256": IDENTITY.inputs_sha256,
        "result_sha256": IDENTITY.result_sha256,
    }
    assert files == {
        "a.csv": {"sha256": hashlib.sha256(b"a.csv").hexdigest(), **about},
        "predictions/b.csv": {"sha256": hashlib.sha256(b"b.csv").hexdigest(), **about},
    }
    # What is gone goes from the list; what another result wrote is marked as that.
    paths[0].unlink()
    later = replace(IDENTITY, run="later")
    remember_files(tmp_path, [paths[1]], later)
    files = json.loads((tmp_path / FILE_LIST).read_text(encoding="utf-8"))["files"]
    assert {name: entry["run"] for name, entry in files.items()} == {"predictions/b.csv": "later"}


@pytest.mark.parametrize("content", ["", "[]", '{"files": []}', '{"files": {"../x": {}, "/etc/passwd": {}}}'])
def test_a_list_of_a_stranger_adds_nothing(tmp_path: Path, content: str) -> None:
    (tmp_path / FILE_LIST).write_text(content, encoding="utf-8")
    (tmp_path / "a.csv").write_text("a", encoding="utf-8")
    remember_files(tmp_path, [tmp_path / "a.csv"], IDENTITY)
    assert list(json.loads((tmp_path / FILE_LIST).read_text(encoding="utf-8"))["files"]) == ["a.csv"]
