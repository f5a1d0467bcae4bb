"""Counting of floating-point operations, against counts by hand."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from native_engine import needs_compiler

from benchmarks.flop_count import _COUNTED, _REPLACED, Operations, copied_sources
from benchmarks.flop_table import _rate
from benchmarks.flops import VARIANTS
from sysid.vehicle_model.native import build, header

#: 2^f: two powers of f, six pairs, three sums of pairs and two of those; e x^2 - 1 of four lanes and a road of 8 rows.
PROGRAM = """
#include <cstdio>
#include "contact.h"
int main() {
  using namespace sysid;
  const Pack x = small_power_of_two(splat(0.25));
  const Count& own = counted[kSets];
  std::printf("%d %d %.17g\\n", (int)own.of[kAdd], (int)own.of[kMultiply], x[0]);
  const Pack y = square_root(2.0 * x - 1.0) / x;
  std::printf("%d %d %d %d\\n", (int)own.of[kAdd], (int)own.of[kMultiply], (int)own.of[kRoot], (int)own.of[kDivide]);
  MapRow row = {};
  row += 2.0 * row;
  std::printf("%d %d\\n", (int)counted[kRoad].of[kAdd], (int)counted[kRoad].of[kMultiply]);
  return y[0] > 2.0;
}
"""


@needs_compiler
def test_packs_count_what_a_person_counts(tmp_path: Path):
    sources = copied_sources(tmp_path / "sources", _REPLACED, patterns=True)
    (sources / _COUNTED.name).write_text(_COUNTED.read_text("utf-8"), "utf-8")
    header.write(tmp_path)
    (tmp_path / "main.cpp").write_text(PROGRAM, encoding="utf-8")
    compiler = build.find_compiler()
    assert compiler is not None
    include = ["-I", str(sources), "-I", str(tmp_path)]
    command = [*compiler, "-std=c++17", "-march=native", *include, str(tmp_path / "main.cpp"), "-o", f"{tmp_path}/main"]
    subprocess.run(command, check=True, capture_output=True)
    done = subprocess.run([str(tmp_path / "main")], check=True, capture_output=True, text=True)
    first, second, road = (line.split() for line in done.stdout.splitlines())
    assert first[:2] == ["11", "13"]
    assert float(first[2]) == pytest.approx(2.0**0.25, rel=3e-16)
    assert second == ["12", "14", "1", "1"]
    assert road == ["8", "8"]


@pytest.mark.parametrize("name", VARIANTS)
def test_what_a_variant_changes_is_in_the_sources(name: str, tmp_path: Path):
    replaced, _ = VARIANTS[name]
    folder = copied_sources(tmp_path, replaced)
    for file, old, new in replaced:
        assert old not in (folder / file).read_text("utf-8")
        assert new in (folder / file).read_text("utf-8")


def test_a_text_that_is_gone_is_named(tmp_path: Path):
    with pytest.raises(ValueError, match=r"pack\.h has 0 places like 'no such text'"):
        copied_sources(tmp_path, [("pack.h", "no such text", "")])


def test_a_rate_counts_the_operations_of_all_sets():
    of = Operations(2e6, 3e6, 0.5e6, 0.25e6, 9e6, 0.25e6)
    found = {"operations": {"linear": of._asdict()}, "laws": ["linear"]}
    # 6 million operations of each of 64 sets in 0.02 s.
    assert _rate(found, {"call": 0, "processor_s": [0.0, 0.02, 1.0]}) == pytest.approx(19.2)
