"""The page as an HTML 5 parser sees it: what browsers, screen readers and attackers get."""

import base64
import json
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from selectolax.lexbor import LexborHTMLParser
from small_results import before_sampling, campaign_only, small_results

from sysid.plot.style import display
from sysid.report import explorer, render_report


@pytest.fixture(scope="module")
def page(full_text):
    return LexborHTMLParser(full_text)


def tags(page):
    return Counter(node.tag for node in page.css("*"))


def test_document_has_language_title_policy_and_ordered_headings(page):
    assert page.css_first("html").attributes["lang"] == "en"
    assert page.css_first("head > title").text() == "Suspension characteristics: Small campaign"
    assert len(page.css("head > meta[http-equiv='Content-Security-Policy']")) == 1
    levels = [int(node.tag[1]) for node in page.css("h1, h2, h3, h4, h5, h6")]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b - a <= 1 for a, b in pairwise(levels))
    for landmark in ("header", "nav", "main", "footer"):
        assert len(page.css(landmark)) == 1


def test_every_control_has_a_label_and_every_label_a_control(page):
    controls = page.css("select, input, textarea")
    assert len(controls) == 6
    names = [node.attributes["for"] for node in page.css("label")]
    assert sorted(names) == sorted(node.attributes["id"] for node in controls)
    assert all(node.text().strip() for node in page.css("label, button, summary, a, h2, h3"))
    assert all(node.attributes["type"] == "button" for node in page.css("button"))


def test_figures_and_tables_say_what_they_are(page):
    for figure in page.css("figure"):
        assert figure.css_first("figcaption").text().strip().startswith("Figure ")
    numbers = [node.text() for node in page.css("figcaption > b")]
    folded = [node.text() for node in page.css("details figcaption > b")]
    assert folded == [f"Figure A{i}." for i in range(1, len(folded) + 1)]
    # What is seen, and printed first, is numbered without gaps.
    seen = [number for number in numbers if number not in folded]
    assert seen == [f"Figure {i}." for i in range(1, len(seen) + 1)]
    for svg in page.css("svg"):
        assert svg.attributes["role"] == "img"
        assert len(svg.attributes["aria-label"]) > 20
    for table in page.css("table"):
        assert table.css_first("caption").text().strip()
        assert {node.attributes.get("scope") for node in table.css("th")} <= {"col", "row"}
        widths = {len(row.css("th, td")) for row in table.css("tr")}
        assert len(widths) == 1, table.css_first("caption").text()
    assert page.css("img") == []


def test_identifiers_are_unique_and_referenced_ones_exist(page):
    names = [node.attributes["id"] for node in page.css("[id]")]
    assert len(names) == len(set(names))
    for attribute in ("aria-labelledby", "for"):
        assert {node.attributes[attribute] for node in page.css(f"[{attribute}]")} <= set(names)
    links = [node.attributes["href"] for node in page.css("a")]
    assert {link[0] for link in links} == {"#"}
    assert {link[1:] for link in links} <= set(names)
    labels = [node.attributes["aria-label"] for node in page.css("[role=region]")]
    assert len(labels) == len(set(labels))


def test_before_any_stage_the_page_is_still_sound():
    page = LexborHTMLParser(render_report(campaign_only()))
    assert page.css(".explorer") == []
    assert len(page.css("h2")) == 11


def test_hostile_names_make_no_element_attribute_or_address(page, hostile_text):
    """Campaign, vehicle, axles, load cases, runs, channels, files, bumps, notes and messages, all hostile at once."""
    hostile = LexborHTMLParser(hostile_text)
    outside = "body *:not(svg *)"
    assert [n.tag for n in hostile.css(outside)] == [n.tag for n in page.css(outside)]
    assert set(tags(hostile)) == set(tags(page))
    for node in hostile.css("*"):
        assert not any(name.startswith("on") or name in ("style", "srcdoc", "pwned") for name in node.attributes)
    assert len(hostile.css("script")) == 3
    assert not any("pwned()" in n.text() for n in hostile.css("script:not([type]), style"))
    # The words are there, as words: escaped once, not interpreted.
    assert "<img src=x onerror=pwned>{{7*7}}" in hostile.css_first("h1").text()
    assert "49" not in hostile.css_first("h1").text()


def test_data_of_the_interactive_figures_are_the_results(hostile_text):
    passes, runs = (
        json.loads(node.text()) for node in LexborHTMLParser(hostile_text).css("script[type='application/json']")
    )
    results = small_results()
    assert [len(run["channels"]) for run in runs] == [3, 3]
    assert "</script>" in runs[0]["name"]
    assert "\u202e" not in runs[0]["name"]
    history, channel = results.fit.histories[1], runs[1]["channels"][1]
    expected, unit = display(history.measured[1], "m")
    values = decoded(channel["measured"], channel["scale"])
    np.testing.assert_allclose(values, expected, atol=0.51 * channel["scale"])
    assert np.isnan(values[100:110]).all()
    assert channel["unit"] == unit == "mm"
    assert channel["scatter"] == pytest.approx(1.644853626951 * 1.0)
    assert runs[0]["channels"][2]["clipped"] == [50, 51, 52]
    assert (runs[0]["start"], runs[0]["step"]) == (0.0, pytest.approx(0.005))
    one = passes[0]["channels"][0]
    assert decoded(one["high"], one["scale"]).max() == pytest.approx(1.8 * 1.05, rel=1e-4)
    assert passes[0]["start"] == -0.5


def test_without_results_there_are_no_data():
    assert explorer.runs_data(campaign_only()) is None
    assert explorer.passes_data(campaign_only()) is None


def test_a_long_campaign_is_thinned_to_what_a_page_can_hold(monkeypatch):
    # Two runs of three channels of 400 samples, measured and simulated: 4,800; every fifth is kept.
    monkeypatch.setattr(explorer, "MOST_SAMPLES", 1000)
    run = json.loads(explorer.runs_data(before_sampling()))[0]
    assert (run["every"], run["step"]) == (5, pytest.approx(0.025))
    channel = run["channels"][2]
    assert len(decoded(channel["middle"], channel["scale"])) == 80
    assert channel["clipped"] == [10]
    # The bands take half as much again.
    assert json.loads(explorer.runs_data(small_results()))[0]["every"] == 8


def test_the_posterior_band_is_kept_as_distances_from_the_simulated_curve():
    history = small_results().fit.histories[0]
    channel = json.loads(explorer.runs_data(small_results()))[0]["channels"][1]
    half = np.exp(-history.time_s)
    for name, sign in (("band_low", -1.0), ("band_high", 1.0)):
        codes = np.frombuffer(base64.b64decode(channel[name]), dtype=np.int8)
        np.testing.assert_allclose(codes * channel["band_step"], sign * half, atol=0.51 / 127.0)
    before = json.loads(explorer.runs_data(before_sampling()))[0]["channels"][1]
    assert "band_low" not in before
    assert set(channel) - set(before) == {"band_low", "band_high", "band_step"}


def decoded(text, scale):
    codes = np.frombuffer(base64.b64decode(text), dtype="<i2")
    return np.where(codes == -32768, np.nan, codes * scale)
