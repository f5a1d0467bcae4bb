"""The page to sign: one page, its words as text, the same bytes each time, whatever names are in it."""

from __future__ import annotations

import re
import zlib
from dataclasses import replace
from pathlib import Path

import pytest
from hostile_text import HOSTILE
from small_results import Words, before_sampling, campaign_only, small_results

from sysid.campaign.records import CampaignDetails
from sysid.export.identity import identity_of
from sysid.export.result_json import result_document
from sysid.report.summary import _END, HEIGHT_IN, WIDTH_IN, _Unseen, summary_pdf, write_summary
from sysid.results.contents import Results

DETAILS = CampaignDetails("2026-05-04", "Tallahassee", "J. W.", "LB-7")


def dated(results: Results) -> Results:
    provenance = {**results.provenance, "date": "2026-11-28T02:15:35+00:00"}
    return replace(results, campaign=replace(results.campaign, details=DETAILS), provenance=provenance)


def unpacked(pdf: bytes) -> str:
    """All streams of a PDF file that this module's figures write, decompressed."""
    parts = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, flags=re.S)
    text = []
    for part in parts:
        try:
            # The last byte of a stream may be a carriage return, which the pattern takes for the end of a line.
            text.append(zlib.decompressobj().decompress(part).decode("latin-1"))
        except zlib.error:
            continue
    return "\n".join(text)


def shown(pdf: bytes) -> str:
    """Letters of the page, in the order in which they are drawn, without blanks."""
    arrays = re.findall(r"\[(.*?)\]\s*TJ|\(((?:\\.|[^\\()])*)\)\s*Tj", unpacked(pdf), flags=re.S)
    letters = "".join("".join(re.findall(r"\(((?:\\.|[^\\()])*)\)", a)) + b for a, b in arrays)
    return re.sub(r"[\s\0]", "", letters.replace("\\(", "(").replace("\\)", ")"))


def test_it_is_one_page_of_a4_with_margins_that_letter_leaves() -> None:
    pdf = summary_pdf(dated(small_results()))
    (box,) = re.findall(rb"/MediaBox \[ ([\d. ]+) \]", pdf)
    assert [float(x) for x in box.split()] == pytest.approx([0.0, 0.0, 72.0 * WIDTH_IN, 72.0 * HEIGHT_IN], abs=0.01)
    assert pytest.approx((210.0, 297.0)) == (25.4 * WIDTH_IN, 25.4 * HEIGHT_IN)
    # Letter is 11 in high: what a centred print loses lies in the margins.
    assert (HEIGHT_IN - 11.0) / 2.0 + 0.25 < _END


def test_it_says_what_was_measured_what_came_out_and_which_result_it_is() -> None:
    results = dated(small_results())
    text = shown(summary_pdf(results))
    identity = identity_of(result_document(results))
    for words in ("Tallahassee", "2026-05-04", "J.W.", "LB-7", "Cankandcbeused?Yes.", "Signature", "Smallcampaign"):
        assert words in text, words
    assert identity.run in text
    assert identity.result_sha256 in text
    for row in (
        "k[kN/m]",
        "c[kNs/m]",
        "static[kN](peakin%)",
        "peakasdriven[kN]",
        "measured",
        "simulated",
        "peakaxleload[kN]",
    ):
        assert row in text, row


def test_its_hash_is_that_of_the_result_and_changes_with_it() -> None:
    results = dated(small_results())
    other = replace(results, warnings=(*results.warnings, "One more."))
    first, second = (identity_of(result_document(r)).result_sha256 for r in (results, other))
    assert first != second
    assert first not in shown(summary_pdf(other))


def test_the_same_results_give_the_same_bytes() -> None:
    assert summary_pdf(dated(small_results())) == summary_pdf(dated(small_results()))


@pytest.mark.parametrize("results", [before_sampling(), campaign_only()], ids=["fit", "nothing"])
def test_what_has_not_run_is_left_out_and_said(results: Results) -> None:
    text = shown(summary_pdf(results))
    assert "Signature" in text
    assert "CONVERGED" not in text or results.fit is not None
    assert ("measured" in text) == (results.fit is not None)


def test_letters_that_its_font_lacks_are_said() -> None:
    name = _Unseen()
    assert name("J\N{LATIN SMALL LETTER O WITH DIAERESIS}rg \N{GREEK SMALL LETTER ALPHA}") == "J\xf6rg \u03b1"
    assert not name.any
    # Chinese has no glyphs here; Arabic has, but they would not join.
    assert name("\u674e") == "\u25af"
    assert _said("\u674e\u96f7 \u0639\u0644\u064a")
    assert name("\u0639\u0644\u064a") == 3 * "\u25af"
    assert not _said("Weiss")


def _said(operator: str) -> bool:
    results = dated(small_results())
    campaign = replace(results.campaign, details=replace(DETAILS, operator=operator))
    return "lettersthatthispagecannotwrite" in shown(summary_pdf(replace(results, campaign=campaign)))


def test_hostile_names_stay_words(tmp_path: Path) -> None:
    words = Words(title=HOSTILE, vehicle=HOSTILE, empty=HOSTILE, case=HOSTILE)
    write_summary(dated(small_results(words)), tmp_path / "summary.pdf")
    content = (tmp_path / "summary.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    for active in (b"/JavaScript", b"/OpenAction", b"/Launch", b"/URI"):
        assert active not in content
