"""Blocks that are written twice: found whatever their names, told apart from lists."""

from __future__ import annotations

from studies.structure import repeats

BODY = """
def {name}(values):
    total = 0.0
    for value in values:
        if value > {limit}:
            total += value
    total = total / len(values)
    return total
"""
LIST = """
def {name}(a, b):
    return make(
        one=a,
        two=b,
        three=a,
        four=b,
        five=a,
        six=b,
    )
"""


def test_a_block_is_found_under_other_names_and_in_the_same_words() -> None:
    first, other = BODY.format(name="mean", limit=0.0), BODY.replace("value", "load").format(name="sum", limit=2.5)
    assert repeats({"a": first, "b": other}) == [(6, "a:3", "b:3", False)]
    assert repeats({"a": first, "b": BODY.format(name="other", limit=0.0)}) == [(6, "a:3", "b:3", True)]
    assert repeats({"a": first, "b": other.replace("return", "yield")}) == []


def test_lists_of_arguments_repeat_nothing() -> None:
    assert repeats({"a": LIST.format(name="f"), "b": LIST.format(name="g")}) == []
