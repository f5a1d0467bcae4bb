"""Passes named on the command line: what they become, and what is said about incomplete ones."""

from __future__ import annotations

from dataclasses import replace

import pytest
from small_results import small_campaign

from sysid.cli.main import cli
from sysid.errors import CampaignError, DataRejectedError
from sysid.workflow.requested_passes import OPTIONS, requested_passes

CAMPAIGN = replace(small_campaign(), scans={"one": None, "two": None})


def test_without_options_the_campaign_decides():
    assert requested_passes(CAMPAIGN, dict.fromkeys(OPTIONS)) == ()
    assert requested_passes(CAMPAIGN, {"speeds": ()}) == ()


def test_every_speed_is_a_pass():
    found = requested_passes(CAMPAIGN, {"speeds": (36.0, 48.0), "load_case": "laden", "bump": "two"})
    assert [(r.load_case, r.bump, r.shape) for r in found] == [("laden", "two", None)] * 2
    assert [r.speed_m_s for r in found] == pytest.approx([10.0, 48.0 / 3.6])
    (first,) = requested_passes(CAMPAIGN, {"speeds": (36.0,)})
    assert (first.load_case, first.bump) == ("empty", "one")


def test_a_shape_needs_no_scan():
    options = {"speeds": (36.0,), "shape": "trapezoid", "height": 0.1, "length": 6.0, "top": 2.0}
    (found,) = requested_passes(small_campaign(), options)
    assert (found.shape.name, found.shape.height_m, found.shape.length_m, found.shape.top_m) == (
        "trapezoid", 0.1, 6.0, 2.0,
    )  # fmt: skip
    assert found.bump == found.shape.label


def test_a_file_is_a_bump_that_no_run_crossed(tmp_path, monkeypatch):
    path = tmp_path / "site" / "hump.csv"
    path.parent.mkdir()
    path.write_text("station_m,height_m\n0,0\n1,0.1\n2,0\n")
    (found,) = requested_passes(CAMPAIGN, {"speeds": (36.0,), "bump": str(path)})
    name = "site/hump.csv"
    assert (found.bump, found.shape.source, found.shape.heights_m) == (name, name, (0.0, 0.1, 0.0))
    monkeypatch.chdir(path.parent)
    assert requested_passes(CAMPAIGN, {"speeds": (36.0,), "bump": "hump.csv"})[0].bump == "hump.csv"
    # A scan of the campaign comes before a file of the same name.
    assert requested_passes(CAMPAIGN, {"speeds": (36.0,), "bump": "one"})[0].shape is None
    path.write_text("")
    with pytest.raises(DataRejectedError, match="is empty"):
        requested_passes(CAMPAIGN, {"speeds": (36.0,), "bump": str(path)})


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"load_case": "laden"}, "--load-case needs a --speed"),
        ({"shape": "watts"}, "--shape needs a --speed"),
        ({"speeds": (30.0,), "load_case": "half"}, "'half' is not in the campaign; it has empty, laden"),
        ({"speeds": (30.0,), "bump": "three"}, "it has one, two"),
        ({"speeds": (30.0,), "bump": "three.crg"}, "neither a scan of the campaign nor a file; the campaign has"),
        ({"speeds": (30.0,), "bump": "x" * 5000 + ".crg"}, "neither a scan"),
        ({"speeds": (30.0,), "bump": "one", "lateral": 1.0}, "name that file by --bump"),
        ({"speeds": (30.0,), "lateral": 1.0}, "name that file by --bump"),
        ({"speeds": (30.0,), "shape": "watts", "height": 0.1, "length": 3.0, "lateral": 1.0}, "name that file"),
        ({"speeds": (30.0,), "height": 0.1}, "size of a --shape"),
        ({"speeds": (30.0,), "shape": "watts", "height": 0.1}, "add --height and --length"),
        ({"speeds": (30.0,), "shape": "watts", "height": 0.1, "length": 3.0, "top": 1.0}, "--top belongs to"),
        ({"speeds": (30.0,), "shape": "watts", "height": 0.1, "length": 3.0, "bump": "one"}, "--bump and --shape"),
    ],
)
def test_what_is_missing_is_said(options, said):
    with pytest.raises(CampaignError, match=said.replace("(", r"\(")):
        requested_passes(CAMPAIGN, options)


def test_a_campaign_without_a_scan_needs_a_shape():
    with pytest.raises(CampaignError, match="no scan of a bump"):
        requested_passes(small_campaign(), {"speeds": (30.0,)})


def test_the_command_line_offers_exactly_these_options():
    names = {p.name for p in cli.commands["predict"].params} - {p.name for p in cli.commands["fit"].params}
    assert names == set(OPTIONS)
