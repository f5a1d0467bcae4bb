"""The wrong number is found by elimination: derived values are computed by hand, and what is wrong is put in."""

from __future__ import annotations

import math

import pytest

from sysid.bookkeeping.elimination import Declared, Derived, sentences

#: 9.81 * 4000 kg / 2 MN/m = 19.6 mm; sqrt(2e6 / 500) / (2 pi) = 10.07 Hz.
LOAD = Declared("axle_loads_kg", "'front'", 4000.0)
MASS = Declared("unsprung_mass_kg", "'front'", 500.0)
MASSES = ("all masses", ("axle_loads_kg", "unsprung_mass_kg"))


def tires(stiffness: float, load: Declared = LOAD, mass: Declared = MASS, name: str = "front") -> list[Derived]:
    declared = Declared("tire_stiffness_N_per_m", f"'{name}'", stiffness)
    sag_mm = 9810.0 * load.value / stiffness
    hop_hz = math.sqrt(stiffness / mass.value) / (2.0 * math.pi)
    return [
        Derived("the tires are compressed by", sag_mm, 3.0, 75.0, "mm", {declared: -1.0, load: 1.0}),
        Derived("the axle carries", load.value, 300.0, 25e3, "kg", {load: 1.0}),
        Derived("the axle hops at", hop_hz, 5.0, 20.0, "Hz", {declared: 0.5, mass: -0.5}),
    ]


def test_usual_values_say_nothing() -> None:
    sag, carried, hop = tires(2e6)
    assert sag.value == pytest.approx(19.62, abs=0.01)
    assert hop.value == pytest.approx(10.07, abs=0.01)
    assert sentences([sag, carried, hop], [MASSES]) == []


@pytest.mark.parametrize(
    ("stiffness", "likely"),
    [(2e3, "in N/mm or kN/m"), (2e6 / 175.127, "in lbf/in"), (2e6 / 9806.65, "in kgf/mm"), (2e9, "")],
)
def test_one_number_that_explains_all_is_named_with_its_unit(stiffness: float, likely: str) -> None:
    (sentence,) = sentences(tires(stiffness), [MASSES])
    assert sentence.startswith(f"tire_stiffness_N_per_m of 'front' ({stiffness:g})")
    assert (f"as if given {likely}" in sentence) == bool(likely)
    assert "axle_loads_kg" not in sentence
    assert "and 1 more such value" in sentence


def test_a_key_that_is_wrong_everywhere_is_named_once() -> None:
    values = [*tires(2e3), *tires(3e3, name="rear")]
    (sentence,) = sentences(values, [MASSES])
    assert sentence.startswith("all tire_stiffness_N_per_m (2000 and 3000), as if given in N/mm or kN/m: ")


def test_two_wrong_numbers_are_two_sentences() -> None:
    load, mass = Declared("axle_loads_kg", "'rear'", 9000.0), Declared("unsprung_mass_kg", "'rear'", 1000.0)
    values = [*tires(2e3), *tires(3e12, load, mass, "rear"), *tires(2.5e6, load, mass, "third")]
    said = sentences(values, [MASSES])
    assert sorted(s.split(" (")[0] for s in said) == [
        "tire_stiffness_N_per_m of 'front'",
        "tire_stiffness_N_per_m of 'rear'",
    ]


def test_masses_are_suspected_together_only() -> None:
    # All masses in t: 4 kg on these tires are 0.02 mm, and half a kilogram hops at 318 Hz. So do stiff tires.
    front = Declared("axle_loads_kg", "'front'", 4.0), Declared("unsprung_mass_kg", "'front'", 0.5)
    rear = Declared("axle_loads_kg", "'rear'", 9.0), Declared("unsprung_mass_kg", "'rear'", 1.0)
    (sentence,) = sentences([*tires(2e6, *front), *tires(3e6, *rear, name="rear")], [MASSES])
    assert sentence.startswith("all masses, as if given in t: ")
    assert "and 5 more such values" in sentence
    assert "axle_loads_kg of 'front'" not in sentence


def test_what_would_make_a_usual_value_unusual_is_no_explanation() -> None:
    first, second = Declared("a_m", "'x'", 10.0), Declared("b_m", "'x'", 1.0)
    values = [
        Derived("the ratio is", 10.0, 0.5, 2.0, "", {first: 1.0, second: -1.0}),
        Derived("the length is", 10.0, 5.0, 20.0, "m", {first: 1.0}),
    ]
    (sentence,) = sentences(values)
    # a / 10 is 1 m, which is not usual; b * 10 breaks nothing.
    assert sentence.startswith("b_m of 'x' (1)")
    # Without the length either may be wrong.
    (sentence,) = sentences(values[:1])
    assert sentence.startswith("Either a_m of 'x' (10)")
    assert "; or b_m of 'x' (1)" in sentence


def test_values_that_no_number_explains_list_their_keys() -> None:
    number = Declared("a_m", "'x'", 10.0)
    values = [
        Derived("the one is", 10.0, 0.5, 2.0, "", {number: 1.0}),
        Derived("the other is", 10.0, 50.0, 60.0, "", {number: 1.0}),
    ]
    assert [s.split(": ")[1] for s in sentences(values)] == ["check a_m of 'x'."] * 2
