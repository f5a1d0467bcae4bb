"""`result.json` against its own schema, checked by the jsonschema package."""

import json
import math
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
from small_results import Words, before_sampling, campaign_only, small_fit, small_results

from sysid.export import result_document, result_schema, write_result
from sysid.results.contents import Judgement, Results
from sysid.validation.channel_agreement import LeftOut, LeftOutRun


@pytest.fixture(scope="module")
def validator():
    schema = result_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("results", [small_results(), before_sampling(), campaign_only()], ids=["all", "fit", "none"])
def test_document_follows_the_schema(validator, results):
    validator.validate(json.loads(json.dumps(result_document(results), allow_nan=False)))


def test_the_verdict_is_there_as_it_was_judged(validator):
    document = result_document(
        replace(small_results(), judgement=Judgement("do_not_bet", ("Why.",), ("sampler",), ("Note.",)))
    )
    verdict = {"trust": "do_not_bet", "reasons": ["Why."], "kinds": ["sampler"], "notes": ["Note."]}
    assert document["verdict"] == verdict
    validator.validate(document)
    assert result_document(small_results())["verdict"] is None
    document["verdict"]["trust"] = "perhaps"
    assert not validator.is_valid(document)


def test_schema_refuses_what_the_contract_does_not_name(validator):
    good = result_document(small_results())
    for broken in (
        good | {"extra": 1},
        good | {"status": "done"},
        good | {"schema": 2},
        good | {"drops": [good["drops"][0] | {"extra": 1}]},
        good | {"parameters": [good["parameters"][0] | {"axle": 0}]},
        good | {"predictions": [good["predictions"][0] | {"file": "../outside.csv"}]},
        {k: v for k, v in good.items() if k != "seed"},
    ):
        assert not validator.is_valid(broken)


def test_every_key_of_the_published_example_is_there():
    document = result_document(small_results())
    assert list(document)[:12] == [
        "schema", "campaign", "status", "seed", "inputs", "likelihood", "warnings", "timings", "drops", "parameters",
        "validation", "predictions",
    ]  # fmt: skip
    assert document["versions"] == small_results().provenance["versions"]
    assert set(document["drops"][0]) == {
        "axle", "load_case", "file", "method", "stiffness", "damping", "stiffness_sd", "damping_sd", "damped_period",
        "log_decrement", "usable", "note", "damping_kind", "friction_force", "friction_force_sd", "quadratic_damping",
        "quadratic_damping_sd",
    }  # fmt: skip
    assert set(document["parameters"][0]) == {
        "name", "axle", "quantity", "load_case", "run", "law", "unit", "identified", "least_squares", "posterior",
        "prior", "variance_shares",
    }  # fmt: skip
    shares = document["parameters"][0]["variance_shares"]
    assert sum(shares.values()) == pytest.approx(1.0)
    assert set(document["parameters"][0]["posterior"]) == {"mean", "sd", "q05", "q50", "q95", "ess", "rhat"}
    assert set(document["validation"][0]) == {"run", "channel", "nrmse", "iso18571", "sprague_geers"}
    (channel,) = document["quality"]
    assert channel["verdict"] == "rejected"
    assert set(channel) == {"file", "channel", "kind", "verdict", "messages"}
    assert set(document["predictions"][0]) == {
        "load_case", "speed_km_h", "axle", "peak_dynamic_load_ratio", "lift_off", "file", "trust", "shape",
    }  # fmt: skip


def test_files_of_before_the_additions_still_fit_the_schema():
    document = result_document(small_results())
    for key in ("identifiability", "advice", "left_out"):
        del document[key]
    for p in document["parameters"]:
        del p["prior"], p["variance_shares"]
    for p in document["predictions"]:
        del p["trust"], p["shape"]
    jsonschema.Draft202012Validator(result_schema()).validate(document)


def test_what_the_data_determine_and_what_would_help():
    document = result_document(small_results())
    assert document["identifiability"]["determined"] == document["identifiability"]["combinations"] == 6
    assert document["identifiability"]["open"] == []
    assert document["parameters"][0]["prior"] == {"median": pytest.approx(1.2 * 4.2e5), "log_sd": 0.4}
    (run,), (sensor,) = document["advice"]["runs"], document["advice"]["sensors"]
    assert document["advice"]["now"]["worst_relative_sd"] == pytest.approx(0.05)
    assert (run["sensor"], run["worst_relative_sd"]) == (None, pytest.approx(0.025))
    assert (sensor["sensor"], sensor["peak_ratio_sd"]) == ("LVDT at axle 2", 0.05)
    before = result_document(campaign_only())
    assert before["identifiability"] is None
    assert before["advice"] is None


def test_ratings_are_written_and_unknown_ones_are_null():
    results = small_results()
    first = result_document(results)["validation"][1]
    assert first["iso18571"] == pytest.approx(0.85)
    assert first["sprague_geers"] == {"magnitude": -0.03, "phase": 0.04}
    blank = replace(results.validation.channels[0], iso18571=math.nan, sprague_geers_magnitude=math.nan)
    unknown = result_document(replace(results, validation=replace(results.validation, channels=(blank,))))["validation"]
    assert unknown[0]["iso18571"] is None
    assert unknown[0]["sprague_geers"] is None


def test_runs_left_out_are_written_with_their_channels_and_shifts():
    results = small_results()
    assert result_document(results)["left_out"] == result_document(campaign_only())["left_out"] == []
    rows = results.validation.channels[:2]
    unknown = replace(rows[1], iso18571=math.nan, sprague_geers_magnitude=math.nan, residual_over_noise=math.inf)
    left = LeftOutRun(
        "runs/r2.csv", np.array([4.1e5, 9e3]), np.array([-2.5, math.nan]), False, 5.5, 0.41, (rows[0], unknown)
    )
    left_out = LeftOut(("k_1", "c_1"), (left,), rows)
    document = result_document(replace(results, validation=replace(results.validation, left_out=left_out)))
    jsonschema.Draft202012Validator(result_schema()).validate(document)
    # The rows of fitted runs stay as they were.
    assert document["validation"] == result_document(results)["validation"]
    assert document["left_out"] == [
        {
            "run": "runs/r2.csv",
            "converged": False,
            "speed": 5.5,
            "start": 0.41,
            "parameters": [
                {"name": "k_1", "value": 4.1e5, "shift_sd": -2.5},
                {"name": "c_1", "value": 9e3, "shift_sd": None},
            ],
            "channels": [
                {"channel": "sensor0_mm", "nrmse": 0.02, "residual_over_noise": 1.0, "iso18571": 0.95}
                | {"sprague_geers": {"magnitude": 0.0, "phase": 0.04}},
                {"channel": "sensor1_mm", "nrmse": 0.04, "residual_over_noise": None, "iso18571": None}
                | {"sprague_geers": None},
            ],
        }
    ]


def test_axles_count_from_one_and_units_are_si():
    document = result_document(small_results())
    by_name = {p["name"]: p for p in document["parameters"]}
    assert document["inputs"] == {"runs/r1.csv": "ab" * 32}
    assert result_document(campaign_only())["inputs"] == {"campaign.toml": "cd" * 32}
    assert by_name["k_1"]["axle"] == 1
    assert by_name["k_1"]["least_squares"] == {"value": 4.2e5, "sd": pytest.approx(4.2e3)}
    assert by_name["k_2[laden]"]["axle"] == 2
    assert by_name["k_2[laden]"]["load_case"] == "laden"
    assert by_name["speed[runs/r1.csv]"]["axle"] is None
    assert by_name["speed[runs/r1.csv]"]["run"] == "runs/r1.csv"
    assert [d["axle"] for d in document["drops"] if d["file"] is None] == [1, 1, 2, 2]
    assert [p["axle"] for p in document["predictions"]] == [1, 2]
    assert document["predictions"][1] == {
        "load_case": "empty",
        "speed_km_h": 48.0,
        "axle": 2,
        "peak_dynamic_load_ratio": {"q05": 3.4, "q50": 3.6, "q95": 3.8},
        "lift_off": True,
        "file": "predictions/empty_48kmh.csv",
        "trust": [
            {"what": "tire_deflection", "axle": 2, "reached": 0.045, "driven": 0.03},
            {"what": "lift_off", "axle": 2, "reached": 0.012, "driven": 0.0},
        ],
        "shape": {"name": "bump", "height_m": 0.08, "length_m": 1.2, "sha256": "ef" * 32},
    }
    assert document["predictions"][0]["trust"] == []


def test_what_is_not_known_is_null():
    document = result_document(small_results())
    unusable = [d for d in document["drops"] if not d["usable"]]
    assert unusable
    assert all(d["stiffness"] is None and d["damping"] is None for d in unusable)
    assert document["timings"] == {"fit": 12.5, "sample": None}
    early = result_document(before_sampling())
    assert all(p["posterior"] is None for p in early["parameters"])
    assert early["likelihood"] is None
    assert early["predictions"][0]["shape"] is None
    assert early["predictions"][0]["peak_dynamic_load_ratio"] == {"q05": None, "q50": 1.8, "q95": None}
    broken = small_fit(parameters=(replace(small_fit().parameters[0], value=math.inf, sd=math.nan),))
    broken = replace(small_results(), fit=broken)
    assert result_document(broken)["parameters"][0]["least_squares"] == {"value": None, "sd": None}


def test_warnings_of_all_stages_appear_once():
    assert result_document(small_results(warnings=("first", "one remark")))["warnings"] == ["first", "one remark"]


def test_same_results_same_bytes_and_hostile_text_survives(tmp_path):
    text = '"}],"x":1</script>\u202e\u2028 =1+1 \U0001f69a'
    for name in ("a.json", "b.json"):
        write_result(small_results(Words.all(text)), tmp_path / name)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    read = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert read["campaign"] == text
    assert read["predictions"][0]["file"].startswith("predictions/x_1_script_")
    assert "/" not in read["predictions"][0]["file"].removeprefix("predictions/")


def test_unknown_status_is_refused():
    with pytest.raises(ValueError, match="done"):
        Results(campaign_only().campaign, status="done")
