"""Which stages run again: after another setting, another file, another schema, other code; and never any more."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, make_dataclass, replace
from pathlib import Path
from typing import Any, Literal

import pytest
from small_results import small_campaign

from sysid.workflow import Calibration, Settings, sources
from sysid.workflow.schema import result_hint, schema_digest, schema_text
from sysid.workflow.stage import Itemwise, Whole
from sysid.workflow.stage_folder import StageFolder, dependents
from sysid.workflow.stages import FIT, SAMPLE, SCAN, STAGES, VALIDATE

EVERY = {stage.name for stage in STAGES}
#: Advice names the peak of a predicted pass.
ON_PREDICT = {"predict", "advise"}
ON_SAMPLE = {"sample", "bands", "estimates"} | ON_PREDICT
ON_FIT = {"fit", "left_out", "validate", "profile", "driven"} | ON_SAMPLE
ON_DROPS = {"drops"} | ON_FIT
#: What each setting makes stale, written down by hand.
STALE: dict[str, set[str]] = {
    "drop_model": ON_DROPS,
    "quick": ON_PREDICT,
    "fit.weight_rounds": ON_FIT,
    "fit.max_iterations": ON_DROPS,
    "fit.second_solver": ON_FIT,
    "fit.tolerance": ON_FIT,
    "fit.target_step_s": ON_DROPS,
    "fit.laws": ON_FIT,
    "fit.contact": ON_FIT,
    "fit.contact_spread": ON_FIT,
    "fit.preview": ON_DROPS,
    "sampling.ensembles": ON_SAMPLE,
    "sampling.walkers_per_parameter": ON_SAMPLE,
    "sampling.segment_steps": ON_SAMPLE,
    "sampling.adapting_steps": ON_SAMPLE,
    "sampling.start_inflation": ON_SAMPLE,
    "sampling.importance_draws": ON_SAMPLE,
    "sampling.importance_suffices": ON_SAMPLE,
    "sampling.seed": ON_SAMPLE,
    "sampling.preview": ON_SAMPLE,
    # A posterior is converged by these; a chain may go on with others.
    "sampling.min_steps": ON_SAMPLE,
    "sampling.rhat_limit": ON_SAMPLE,
    "sampling.min_effective": ON_SAMPLE,
    # This limits how long a chain goes on, not what it is.
    "sampling.max_steps": set(),
    "validation.nrmse": {"validate"},
    "validation.peak_error": {"validate"},
    "validation.sprague_geers_magnitude": {"validate"},
    "validation.sprague_geers_phase": {"validate"},
    "validation.iso18571": {"validate"},
}


def leaves(value: Any, before: str = "") -> dict[str, Any]:
    """Every single setting by its path."""
    found: dict[str, Any] = {}
    for f in fields(value):
        member = getattr(value, f.name)
        found |= leaves(member, f"{before}{f.name}.") if is_dataclass(member) else {before + f.name: member}
    return found


def changed(settings: Any, name: str) -> Any:
    """Settings with another value of one of them."""
    first, _, rest = name.partition(".")
    value = getattr(settings, first)
    if rest:
        return replace(settings, **{first: changed(value, rest)})
    other = {bool: lambda: not value, str: lambda: value + "x"}.get(type(value), lambda: value + 1)()
    return replace(settings, **{first: other})


def fingerprints(folder: Path, settings: Settings | None = None, campaign: Any = None) -> dict[str, str]:
    found = StageFolder(folder, settings or Settings(), campaign or small_campaign())
    return {stage.name: found.fingerprint(stage) for stage in STAGES}


def stale(one: Mapping[str, str], other: Mapping[str, str]) -> set[str]:
    return {name for name in one if one[name] != other[name]}


def test_every_setting_has_its_line():
    assert STALE.keys() == leaves(Settings()).keys()


@pytest.mark.parametrize("name", STALE)
def test_a_setting_makes_exactly_those_stages_stale_that_use_it(tmp_path: Path, name: str) -> None:
    before, after = fingerprints(tmp_path), fingerprints(tmp_path, changed(Settings(), name))
    assert stale(before, after) == STALE[name]


def test_a_log_leaves_the_scan_as_it_is_and_the_campaign_file_nothing(tmp_path: Path) -> None:
    campaign = small_campaign()
    log = campaign.bump_runs[0].log.file
    files = {"campaign.toml": "a", "scan.csv": "b", log: "c"}
    campaign = replace(campaign, input_sha256=files)
    before = fingerprints(tmp_path, campaign=campaign)

    def after(name: str) -> set[str]:
        return stale(before, fingerprints(tmp_path, campaign=replace(campaign, input_sha256={**files, name: "other"})))

    assert after(log) == EVERY - {"scan"}
    assert after("scan.csv") == EVERY
    assert after("campaign.toml") == EVERY


def test_what_rests_on_a_stage_is_found_over_several_steps():
    assert {s.name for s in dependents(SAMPLE)} == ON_SAMPLE - {"sample"}
    assert {s.name for s in dependents(FIT)} == ON_FIT - {"fit"}
    assert {s.name for s in dependents(SCAN)} == ON_FIT
    assert dependents(VALIDATE) == ()


def made(name: str, **members: Any) -> type:
    return make_dataclass(name, members.items(), frozen=True)


INNER = made("Inner", value=float)


@pytest.mark.parametrize(
    "other",
    [
        made("Result", a=int, inner=tuple[INNER, ...], more=bool),
        made("Result", b=int, inner=tuple[INNER, ...]),
        made("Result", a=float, inner=tuple[INNER, ...]),
        made("Result", a=int | None, inner=tuple[INNER, ...]),
        made("Result", a=int, inner=tuple[INNER, INNER]),
        made("Result", a=int, inner=tuple[made("Inner", value=float, sd=float), ...]),
        made("Result", a=int, inner=tuple[made("Inner", value=Literal["x"]), ...]),
        made("Other", a=int, inner=tuple[INNER, ...]),
    ],
)
def test_another_field_or_type_anywhere_is_another_schema(other: type) -> None:
    same = made("Result", a=int, inner=tuple[made("Inner", value=float), ...])
    assert schema_digest(made("Result", a=int, inner=tuple[INNER, ...])) == schema_digest(same)
    assert schema_digest(other) != schema_digest(same)


def test_another_schema_makes_a_stage_and_those_that_rest_on_it_stale(tmp_path: Path, monkeypatch) -> None:
    before = fingerprints(tmp_path)
    real = result_hint(SAMPLE)
    monkeypatch.setattr(
        "sysid.workflow.stage_folder.schema_digest",
        lambda hint: "another" if hint is real else schema_digest(hint),
    )
    assert stale(before, fingerprints(tmp_path)) == ON_SAMPLE


def test_every_stage_says_what_its_file_may_hold():
    for stage in STAGES:
        assert "Any" not in schema_text(result_hint(stage)), stage.name
    assert "identifiability: Union[Identifiability(" in schema_text(result_hint(FIT))
    with pytest.raises(TypeError, match="cannot be kept"):
        schema_text(made("Result", a=list[int]))
    with pytest.raises(TypeError, match="cannot be kept"):
        schema_text(Any)


def test_other_code_makes_those_stale_that_use_it(tmp_path: Path, monkeypatch) -> None:
    for name, text in {
        "upper/a.py": "from sysid.lower import b\n", "lower/b.py": "", "apart/c.py": "", "alone.py": "",
        "late/d.py": "def f():\n    from sysid import alone, lower\n",
    }.items():  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(sources, "ROOT", tmp_path)

    def digests() -> dict[str, str]:
        sources._hash_and_imports.cache_clear()
        sources._stored_hashes.cache_clear()
        return {name: sources.code_digest((name,)) for name in ("upper", "lower", "apart", "late", "alone")}

    try:
        before = digests()
        assert sources.imported_by(["late"]) == {"late", "alone", "lower"}
        (tmp_path / "lower" / "b.py").write_text("x = 1\n")
        assert stale(before, digests()) == {"upper", "lower", "late"}
        (tmp_path / "lower" / "b.py").write_text('"""Other words."""\n# A remark.\n')
        assert stale(before, digests()) == set()
        (tmp_path / "lower" / "b.h").write_text("// A remark.")
        assert stale(before, digests()) == {"upper", "lower", "late"}
        (tmp_path / "lower" / "b.h").unlink()
        (tmp_path / "alone.py").write_text("x = 1\n")
        assert stale(before, digests()) == {"late", "alone"}
    finally:
        sources._hash_and_imports.cache_clear()


@pytest.mark.parametrize("stage", STAGES, ids=lambda s: s.name)
def test_the_record_names_the_packages_that_its_function_calls(stage: Any) -> None:
    function = stage.compute if isinstance(stage, Whole) else stage.each
    assert isinstance(stage, Whole | Itemwise)
    called = set(re.findall(r"from sysid\.(\w+)", inspect.getsource(function))) - {"workflow"}
    assert called <= sources.imported_by(stage.code)
    # Without any package named the hash of the code would say nothing.
    assert stage.code


def test_a_run_removes_what_killed_processes_left_half_written(tmp_path, monkeypatch):
    for name in ("", "stages", "models/empty", "predictions"):
        (tmp_path / name).mkdir(parents=True, exist_ok=True)
        (tmp_path / name / ".writing-abc.csv").write_text("half")
    (tmp_path / "models" / "kept.csv").write_text("whole")
    calibration = Calibration(Path(__file__).parents[2] / "examples" / "linear_truck", tmp_path)
    monkeypatch.setattr("sysid.workflow.stages.STAGES", ())
    monkeypatch.setattr("sysid.workflow.stages.ENDINGS", ())
    calibration.run()
    assert not list(tmp_path.rglob(".writing-*"))
    assert (tmp_path / "models" / "kept.csv").exists()
