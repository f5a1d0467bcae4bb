"""The page parsed again: structure, policy, words, and hostile text that must stay text."""

import base64
import hashlib
import math
import re
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pytest
from hostile_text import HOSTILE
from small_results import Words, before_sampling, campaign_only, small_results

from sysid import plot
from sysid.report import render_report, write_report
from sysid.report.figures import Gallery
from sysid.report.first_screen import truck_rows, worst_picture
from sysid.report.page import _subject
from sysid.results.headline import largest_at_any_speed, largest_loads

VOID = {"meta", "br", "link", "img", "input", "hr"}


@dataclass
class Page:
    """Elements of a page in order, its visible text and its problems of nesting."""

    elements: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    text: dict[str, list[str]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]

    def words(self):
        return " ".join(" ".join(t) for tag, t in self.text.items() if tag not in ("style", "script"))


class _Reader(HTMLParser):
    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.page, self.open = Page(), []

    def handle_starttag(self, tag, attrs):
        if len({name for name, _ in attrs}) < len(attrs):
            self.page.problems.append(f"attribute twice in <{tag}>")
        self.page.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.page.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.page.problems.append(f"</{tag}> closes nothing")

    def handle_comment(self, data):
        self.page.problems.append(f"comment {data}")

    def handle_data(self, data):
        self.page.text.setdefault(self.open[-1] if self.open else "", []).append(data)


def parse(text):
    reader = _Reader()
    reader.feed(text)
    reader.close()
    reader.page.problems += [f"<{tag}> left open" for tag in reader.open]
    return reader.page


@pytest.fixture(scope="module")
def full(full_text):
    return parse(full_text)


def skeleton(page):
    """Elements outside figures with the names of their attributes."""
    svg = {"svg", "g", "path", "text", "use", "defs", "clippath", "rect", "image"}
    return [(tag, tuple(attributes)) for tag, attributes in page.elements if tag not in svg]


def test_hostile_text_adds_no_element_and_no_attribute(full, hostile_text):
    page = parse(hostile_text)
    assert page.problems == []
    assert skeleton(page) == skeleton(full)
    assert {tag for tag, _ in page.elements} == {tag for tag, _ in full.elements}
    for tag, attributes in page.elements:
        assert not any(name.startswith("on") or name == "style" for name in attributes), tag
        assert "pwned" not in " ".join(attributes)
        for name in ("href", "src", "action"):
            assert re.match(r"#|data:image/png;base64,", attributes.get(name) or "#")
    assert "{{7*7}}{% raw %}<!-- ]]> &lt;pwned&gt;" in page.words()
    assert "\u202e" not in page.words()
    assert "\x00" not in page.words()


def test_hostile_text_stays_text_before_the_first_stage():
    page = parse(render_report(campaign_only(Words.all(HOSTILE))))
    assert page.problems == []
    assert skeleton(page) == skeleton(parse(render_report(campaign_only())))


def test_page_is_well_formed_and_identifiers_are_distinct(full):
    assert full.problems == []
    names = [a["id"] for _, a in full.elements if a.get("id")]
    assert len(names) == len(set(names))
    targets = {a["href"][1:] for a in full.all("a")}
    assert targets <= set(names)
    labels = {a["aria-labelledby"] for _, a in full.elements if a.get("aria-labelledby")}
    assert labels <= set(names)


def test_policy_admits_our_style_and_script_only(full, full_text):
    (policy,) = [a["content"] for a in full.all("meta") if a.get("http-equiv") == "Content-Security-Policy"]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    for tag in ("style", "script"):
        content = re.search(f"<{tag}>(.*?)</{tag}>", full_text, re.DOTALL)[1]
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert rules[f"{tag}-src"] == f"'sha256-{digest}'"
    assert rules["default-src"] == "'none'"
    assert rules["img-src"] == "data:"
    assert not any("style" in a for _, a in full.elements)


def test_page_loads_nothing(full, full_text):
    assert {a.get("href", "#")[0] for a in full.all("a")} == {"#"}
    assert not full.all("link")
    assert not re.search(r"https?://", full_text)
    assert "@import" not in full_text
    assert "url(" not in "".join(full.text["style"])


def test_page_is_accessible(full):
    assert full.all("html")[0]["lang"] == "en"
    assert full.all("a")[0]["class"] == "skip"
    assert all(a.get("scope") in ("col", "row") for a in full.all("th"))
    assert len(full.all("caption")) == len(full.all("table"))
    assert all(a.get("role") == "img" and a["aria-label"] for a in full.all("svg"))
    levels = [int(tag[1]) for tag, _ in full.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b - a <= 1 for a, b in pairwise(levels))


def test_figures_are_not_empty(full_text):
    figures = re.findall(r"<svg.*?</svg>", full_text, re.DOTALL)
    # The truck, loads against speed, the worst channel; histories, load ratio and suspension force of axle 1; all axles
    # of a pass, ratio against speed, two comparisons, drops (overview and two axles), profile, scan and what tires
    # feel, all channels of a run, residuals, modes of two load cases, priors, further runs, marginals, correlation,
    # pairs, traces.
    assert len(figures) == 27
    assert all(figure.count("<path") + figure.count("<use") > 10 for figure in figures)
    assert len(full_text) < 1_500_000


def test_first_screen_gives_verdict_next_step_and_values_with_interval_and_unit(full_text):
    first = full_text[: full_text.index('id="histories"')]
    text = " ".join(re.sub("<[^>]*>", " ", re.sub("<svg.*?</svg>", "", first, flags=re.DOTALL)).split())
    text = text.replace("\xa0", " ")
    assert "Can I use k and c?" in text
    assert "· sysid 0.1.0 ·" in text[: text.index("Can I use")]
    assert text.index("Next:") < text.index("Figure 1.")
    assert "CONVERGED" in text
    s = small_results().posterior.summaries[0]
    assert f"{s.q50 / 1e3:.0f} [{s.q05 / 1e3:.0f}, {s.q95 / 1e3:.0f}]" in text
    assert "k [kN/m]" in text
    assert "90 % credible interval" in text
    assert text.count("one remark") == 1


def test_the_head_names_the_day_of_the_calibration_where_it_is_known():
    results = small_results()
    dated = replace(results, provenance={**results.provenance, "date": "2026-03-04T05:06:07+00:00"})
    assert "calibrated 2026-03-04" in _subject(dated)
    assert not [text for text in _subject(results) if "calibrated" in text]


def test_the_truck_carries_k_c_static_and_peak_load_of_every_axle(full_text):
    results = small_results()
    truck = re.search('<figure class="wide truck">.*?</svg>', full_text, re.DOTALL)[0]
    written = re.findall("<text[^>]*>([^<]*)</text>", truck)
    for s in results.posterior.summaries[:1]:
        assert any(t.startswith(f"{s.q50 / 1e3:.0f} \N{PLUS-MINUS SIGN}") for t in written)
    # The largest of all speeds, by the sweep itself.
    (sweep,) = results.predictions.sweeps
    mass = np.array(results.campaign.load_cases[sweep.load_case].axle_loads_kg)
    static = mass * results.campaign.vehicle.gravity_m_s2 / 1e3
    loads = sweep.peak_ratio.q50 * static
    shown = {i: float(re.match(r"[\d.]+", t)[0]) for i, t in enumerate(written) if "\N{PLUS-MINUS SIGN}" in t}
    for value in loads.max(axis=0):
        assert any(abs(v - value) < 0.006 * v for v in shown.values())
    # And of the speeds that the runs back, with its share of the load at rest.
    assert sweep.beyond is None
    backed = np.broadcast_to((sweep.speed_m_s <= 1.06 * sweep.driven_m_s[1])[:, None], loads.shape)
    assert not backed.all()
    for axle, value in enumerate(np.where(backed, loads, 0.0).max(axis=0)):
        (at,) = [i for i, v in shown.items() if abs(v - value) < 0.006 * v and not written[i].endswith("*")]
        assert f"{sweep.speed_m_s[int(np.where(backed, loads, 0.0)[:, axle].argmax())] * 3.6:g}" in written[at + 1]
        assert f"{static[axle]:.1f} ({100.0 * value / static[axle]:.0f} %)" in written
    label = re.search('aria-label="([^"]*)"', truck[truck.index("<svg") :])[1]
    assert "peak as driven [kN]: axle 1" in label
    # Where the runs back none, the passes that were asked for stand there.
    nowhere = replace(sweep, beyond=np.ones(loads.shape, bool))
    rows = truck_rows(replace(results, predictions=replace(results.predictions, sweeps=(nowhere,)))).texts
    assert "peak as driven [kN]" not in dict(rows)
    for load, text in zip(largest_loads(results), dict(rows)["peak in pass [kN]"], strict=True):
        assert float(re.match(r"[\d.]+", text)[0]) == pytest.approx(load.peak_N / 1e3, rel=0.006)
        assert load.pass_name in text


def test_the_largest_load_is_that_of_all_load_cases():
    results = small_results()
    (sweep,) = results.predictions.sweeps
    case = next(name for name in results.campaign.load_cases if name != sweep.load_case)
    mass = np.array(results.campaign.load_cases[sweep.load_case].axle_loads_kg)
    other = np.array(results.campaign.load_cases[case].axle_loads_kg)
    for factor, of in ((1.1, case), (0.9, sweep.load_case)):
        ratio = factor * sweep.peak_ratio.q50 * mass / other
        second = replace(sweep, load_case=case, peak_ratio=replace(sweep.peak_ratio, q50=ratio))
        both = replace(results.predictions, sweeps=(sweep, second))
        loads = largest_at_any_speed(replace(results, predictions=both))
        assert [load.load_case for load in loads] == [of] * len(mass)


def test_the_worst_channel_is_the_one_with_the_largest_residual_over_noise():
    results = small_results()
    (picture,) = worst_picture(results, Gallery())
    worst = max(results.validation.channels, key=lambda r: r.residual_over_noise)
    assert worst.run in picture.caption
    assert f"{worst.residual_over_noise:.2g} times" in picture.caption
    # Another record made the worst is the one that is shown.
    other = min(results.validation.channels, key=lambda r: r.residual_over_noise)
    rows = tuple(replace(r, residual_over_noise=99.0) if r is other else r for r in results.validation.channels)
    (changed,) = worst_picture(replace(results, validation=replace(results.validation, channels=rows)), Gallery())
    assert "99 times" in changed.caption


def test_drops_that_are_not_to_be_used_alone_leave_the_summary_figure_once_there_is_a_fit():
    def marks(rows):
        return [len(line.get_xdata()) for line in plot.comparison(rows, "stiffness").lines]

    rows = small_results().suspension("stiffness")
    doubted = tuple(
        replace(row, estimates={k: replace(e, alone=k in ("fitted", "posterior")) for k, e in row.estimates.items()})
        for row in rows
    )
    assert len(marks(doubted)) < len(marks(rows))
    drops_only = tuple(
        replace(row, estimates={k: e for k, e in row.estimates.items() if not e.alone}) for row in doubted
    )
    assert len(marks(drops_only)) > 0


def test_result_and_what_the_paper_shows_come_before_the_order_of_the_work(full):
    targets = [a["id"] for tag, a in full.elements if tag == "h2"]
    expected = "result histories predictions compare quality drops road fit posterior validation provenance"
    assert targets == expected.split()


def test_stages_that_have_not_run_are_named():
    page = render_report(campaign_only())
    for stage in ("check", "drops", "fit", "sample", "predict"):
        assert f"Run the stage <code>{stage}</code> to add it" in page
    words = parse(page).words()
    assert "NO ESTIMATES YET" in words
    assert not re.search(r"\b(nan|None|inf)\b", words)


def test_report_before_sampling_names_the_other_interval():
    words = parse(render_report(before_sampling())).words().replace("\xa0", " ")
    assert "LEAST SQUARES ONLY" in words
    assert "90 % confidence interval" in words
    assert "90 % credible interval)" not in words
    assert "no interval yet" in words


def test_preview_is_marked_everywhere():
    page = parse(render_report(small_results(status="preview", fit=None, posterior=None)))
    words = page.words()
    assert page.text["title"][0].startswith("PREVIEW")
    tags = [a for a in page.all("span") if a.get("class") == "tag stop"]
    marked = len(page.all("h2")) - 1 + len(page.all("figure")) + len(page.all("table"))
    # Declared inputs and provenance are facts, not results: their four tables stay unmarked.
    assert len(page.all("figure")) >= 7
    assert len(tags) == marked - 4
    assert "Not for decisions" in words


def test_page_is_written_whole_and_the_same_each_time(tmp_path, full_text):
    shares: list[float] = []
    write_report(small_results(), tmp_path / "report.html", shares.append)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == full_text
    # It says how far it is with every figure.
    assert shares[-1] == 1.0
    assert len(shares) == full_text.count("<figure")
    assert np.all(np.diff(shares) > 0.0)


def test_results_with_holes_still_make_a_page():
    nan = math.nan
    r = small_results()
    first = r.drops.files[0]
    empty = np.zeros(0)
    reading = replace(
        first.reading, extremum_time_s=empty, extremum_value_m=empty, used=np.zeros(0, bool), usable=False,
        damped_period=nan, damped_period_se=nan, log_decrement=nan, log_decrement_se=nan, settled_level=nan,
    )  # fmt: skip
    drop = replace(first, reading=reading, release_time_s=nan, frequency_hz=nan, free_decay_m=np.full(1000, nan))
    history = r.fit.histories[0]
    dead = np.full_like(history.measured, nan)
    draws = r.posterior.draws.copy()
    draws[..., 0] = 4e5
    one = r.predictions.passes[0]
    scan = replace(r.scans["bump"], strip_station_m=empty, strip_height_m=empty)
    scan = replace(scan, cloud_along_m=empty, cloud_across_m=empty, cloud_height_m=empty)
    every = np.full((6, 20), nan)
    unknown = replace(r.fit.residual_evidence, autocorrelation_before=every, autocorrelation_after=every)
    page = parse(
        render_report(
            replace(
                r,
                drops=replace(r.drops, files=(drop,), pooled=()),
                scans={"bump": scan},
                fit=replace(r.fit, histories=(replace(history, measured=dead),), residual_evidence=unknown),
                posterior=replace(r.posterior, draws=draws),
                predictions=replace(r.predictions, passes=(replace(one, peak_ratio_q50=np.full(2, nan)),)),
            )
        )
    )
    assert page.problems == []
    assert not re.search(r"\b(nan|None|inf)\b", page.words())
