"""What the screen shows of passes over bridges."""

from __future__ import annotations

from dataclasses import replace

from bridge_results import loads, over

from sysid.display import TextTable
from sysid.workflow.stages.bridges import shown_bridges


def test_of_several_speeds_each_load_effect_stands_at_its_worst():
    # Moments are worst at 20 m/s, deflections at 30 m/s.
    slow, fast = loads(1.1), loads(1.2)
    middle = replace(slow, effects=(loads(1.4).effects[0], slow.effects[1]))
    passes = [over(10.0, slow), over(20.0, middle), over(30.0, fast)]
    passes = [replace(p, warnings=(f"pass {k}", "all")) for k, p in enumerate(passes)]
    effects, codes, *sentences = shown_bridges(passes)
    assert isinstance(effects, TextTable)
    assert "36 to 108 km/h" in effects.title
    assert [(row[0], row[4], row[6], row[8]) for row in effects.rows] == [
        ("moment at 10 m", "420.0", "1.400", "72"),
        ("deflection at 10 m", "2.400", "1.200", "108"),
    ]
    assert isinstance(codes, TextTable)
    assert [row[1] for row in codes.rows] == ["0.70", "0.60"]
    # What is said of passes that are worst for nothing is in the tables; each sentence once.
    assert sentences[1:4] == ["pass 1", "all", "pass 2"]
    assert "3 passes" in sentences[4]


def test_another_load_case_is_another_table_and_one_pass_says_where_it_stands():
    laden = over(20.0, loads())
    shown = list(shown_bridges([laden, replace(laden, load_case="empty"), over(30.0, loads(1.3))]))
    tables = [block for block in shown if isinstance(block, TextTable)]
    assert [len(t.rows) for t in tables] == [2, 2, 2, 2]
    assert tables[0].columns[-1] == "at km/h"
    assert tables[2].title.startswith("empty, 72 km/h")
    assert (tables[2].columns[-1], tables[2].rows[0][-1]) == ("axle 1 at m", "12.00")
