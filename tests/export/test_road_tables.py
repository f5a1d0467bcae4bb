"""Tables of passes over rough roads: columns, units and quantiles against values made by hand."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from road_results import over_road

from sysid.export.road_tables import road_texts


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_every_pass_has_its_tables_and_two_passes_share_one():
    random = np.random.default_rng(1)
    load = 1e5 + 1e3 * random.normal(size=(400, 3))
    slow, fast = over_road(10.0), over_road(20.0)
    slow = replace(slow, road=replace(slow.road, aggregate_N=load))
    fast = replace(fast, road=replace(fast.road, aggregate_N=2.0 * load))
    other = over_road(20.0, shape="road class C, 100 m, seed 0")
    texts = road_texts((slow, fast, other), "repeatability", "use")
    assert len(texts) == 10
    (name,) = (n for n in texts if n.startswith("predictions/laden_72kmh_road_class_b") and n.endswith("_spectra.csv"))
    spectra = rows(texts[name])
    assert float(spectra[8]["frequency_hz"]) == pytest.approx(1.0)
    # 1e6 N2/Hz are 1 kN2/Hz.
    assert float(spectra[8]["axle_load2_kN2_per_Hz_q50"]) == pytest.approx(1.0)
    assert float(spectra[8]["axle_load1_kN2_per_Hz_q95"]) == pytest.approx(0.55)
    ranges = rows(texts[name.replace("_spectra", "_ranges")])
    (one,) = (r for r in ranges if (r["axle"], r["force"], r["range_over_static"]) == ("2", "suspension_force", "0.5"))
    assert float(one["range_kN"]) == pytest.approx(40.0)
    assert float(one["more_per_km_q50"]) == pytest.approx(10.0)
    along = rows(texts[name.replace("_spectra", "_along")])
    assert float(along[4]["station_m"]) == 1.0
    assert float(along[4]["aggregate_load_kN_q50"]) == pytest.approx(2e-3 * np.median(load[4]), rel=1e-3)
    pairs = {
        (r["speed_km_h"], r["other_speed_km_h"], r["road"]): r for r in rows(texts["predictions/repeatability.csv"])
    }
    found = pairs["36.0", "72.0", slow.shape]
    assert float(found["repeatability_q50"]) == pytest.approx(1.0)
    assert found["verdict"] == "use"
    assert ("72.0", "72.0", other.shape) in pairs
    assert not any({slow.shape, other.shape} <= set(r.values()) for r in pairs.values())


def test_a_pass_over_a_bump_has_none():
    assert road_texts((replace(over_road(), road=None),), "repeatability") == {}
