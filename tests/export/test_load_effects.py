"""Tables of load effects on bridges: rows, ratios over codes, histories, and `result.json`."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pandas as pd
import pytest
from bridge_results import loads, over

from sysid.csv_cells import columns_text
from sysid.export.load_effects import (
    concurrent_csv,
    effect_histories_csv,
    load_effect_documents,
    load_effects_csv,
    write_load_effects,
)
from sysid.export.result_json import result_schema


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_a_row_per_effect_with_its_share_of_the_code():
    found = rows(load_effects_csv([over(20.0, loads(1.2))], "use"))
    assert [r["effect"] for r in found] == ["moment at 10 m", "deflection at 10 m"]
    moment = found[0]
    assert float(moment["dynamic_q50"]) == pytest.approx(3.6e5)
    assert float(moment["dynamic_q05"]) == pytest.approx(0.9 * 3.6e5)
    assert float(moment["code_LM1"]) == pytest.approx(6e5)
    assert float(moment["over_LM1"]) == pytest.approx(0.6)
    assert (moment["unit"], moment["verdict"], moment["speed_km_h"]) == ("N m", "use", "72.0")


def test_concurrent_values_and_histories():
    found = rows(concurrent_csv([over(20.0, loads())]))
    assert [(r["extreme_of"], r["concurrent_effect"], float(r["value"])) for r in found[:2]] == [
        ("moment at 10 m", "moment at 10 m", 3e5),
        ("moment at 10 m", "deflection at 10 m", 0.0),
    ]
    table = rows(effect_histories_csv(loads()))
    assert len(table) == 21
    at = [float(r["moment at 10 m [N m] q95"]) for r in table]
    assert np.allclose(at, 1.1 * loads().history.q50[0], rtol=1e-6, atol=1.0)


def test_columns_of_numbers_are_as_pandas_writes_them():
    values = np.random.default_rng(4).normal(size=50) * 10.0 ** np.arange(-25, 25)
    columns = {"a, m": values, "nan": np.where(values > 0, values, np.nan), 'b "c"': np.full(50, np.nan)}
    assert columns_text(columns) == pd.DataFrame(columns).to_csv(index=False, lineterminator="\n", float_format="%.7g")


def test_the_document_is_as_the_schema_says():
    validators = pytest.importorskip("jsonschema")
    whole = result_schema()
    schema = {"$defs": whole["$defs"], "type": "array", "items": {"$ref": "#/$defs/load_effect"}}
    document = json.loads(json.dumps(load_effect_documents([over(20.0, loads())])))
    validators.validate(document, schema)
    assert document[0]["codes"]["LM1"]["over"] == pytest.approx(0.6)
    document[0]["sense"] = "most"
    with pytest.raises(validators.ValidationError):
        validators.validate(document, schema)


def test_nothing_is_written_without_a_bridge(tmp_path):
    assert write_load_effects([], tmp_path, "load_effects") == ()
    assert len(write_load_effects([over(20.0, loads())], tmp_path, "load_effects")) == 3
