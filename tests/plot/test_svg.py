"""The inline SVG: parsed again by an XML parser, references resolved, nothing a strict page forbids."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from small_results import small_results

from sysid import plot
from sysid.plot.svg import _compact_path


@pytest.fixture(scope="module")
def svg():
    results = small_results()
    return plot.svg_element(plot.suspension_histories(results.fit.histories[0], (0,))[0, 0].figure, "f1", 'A "b" <c>')


def test_one_element_with_a_description(svg):
    root = ET.fromstring(svg)
    assert root.tag == "svg"
    assert root.get("role") == "img"
    assert root.get("aria-label") == 'A "b" <c>'
    assert len(list(root.iter("path"))) > 10
    assert {"measured", "simulated"} <= {t.text for t in root.iter("text")}


def test_nothing_that_a_strict_policy_forbids(svg):
    root = ET.fromstring(svg)
    for element in root.iter():
        assert element.tag in {"svg", "g", "path", "text", "use", "defs", "clipPath", "rect", "image"}
        assert not {"style", "onload", "class"} & set(element.attrib) or element is root
        assert all("http" not in value for value in element.attrib.values())
        assert re.match(r"#|data:image/png;base64,", element.get("href", "#"))


def test_identifiers_are_distinct_and_all_references_resolve(svg):
    root = ET.fromstring(svg)
    names = [e.get("id") for e in root.iter() if e.get("id")]
    assert len(names) == len(set(names))
    assert all(name.startswith("f1-") for name in names)
    used = {e.get("href")[1:] for e in root.iter("use")} | set(re.findall(r"url\(#([^)]+)\)", svg))
    assert used
    assert used <= set(names)


def test_compact_paths_keep_their_points():
    assert _compact_path("M 1 2 \nL 3 4 \nL -5 .6 \nM 7 8 \nL 9 10 \nz\n") == "M1 2 3 4 -5 .6M7 8 9 10z"
    assert _compact_path("M 1 2 \nQ 3 4 5 6 \nL 7 8 \n") == "M1 2Q3 4 5 6L7 8"


def test_a_line_keeps_its_coordinates():
    fig = plot.figure(4.0, 3.0, (0.0,) * 6)
    ax = fig.add_subplot()
    ax.set(xlim=(0, 288), ylim=(0, 216))
    x, y = np.array([10.0, 100.0, 250.0]), np.array([20.0, 200.0, 123.456])
    ax.plot(x, y, color="#123456")
    root = ET.fromstring(plot.svg_element(fig, "p", ""))
    (path,) = (e for e in root.iter("path") if e.get("stroke") == "#123456")
    numbers = np.array([float(v) for v in re.findall(r"-?[\d.]+", path.get("d"))]).reshape(-1, 2)
    np.testing.assert_allclose(numbers, np.column_stack((x, 216.0 - y)), atol=0.0051)


def test_same_figure_same_text():
    results = small_results()
    first, second = (plot.svg_element(plot.drop(results.drops.files[0]).figure, "d", "x") for _ in range(2))
    assert first == second
