"""Load effects on the page: numbers, codes, and nothing for passes over no bridge."""

from __future__ import annotations

from dataclasses import replace

from bridge_results import loads
from small_results import small_results

from sysid.report.load_tables import effect_tables
from sysid.report.page import render_report


def test_load_effects_beside_codes():
    results = small_results()
    assert results.predictions is not None
    plain = results.predictions.passes[0]
    assert effect_tables(results) == [None] * len(results.predictions.passes)
    bridged = replace(plain, bridge=loads(1.2), shape="bridge river")
    both = replace(results, predictions=replace(results.predictions, passes=(plain, bridged)))
    none, table = effect_tables(both)
    assert none is None
    assert table is not None
    moment = [cell.text for cell in table.rows[0]]
    assert moment[:5] == ["moment at 10 m", "kN m", "300", "300", "360"]
    assert moment[5:] == ["1.200", "0.60"]
    page = render_report(both)
    assert "Load effects on the bridge against time" in page
    assert "Load effects on the bridge against time" not in render_report(results)
