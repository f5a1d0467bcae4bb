"""Which declared number is wrong where values that follow from it are not usual: found by elimination.

A derived value is a product of powers of declared numbers, y = a x_1^p1 x_2^p2 ..., with a usual range of y. A number
explains the unusual values that it enters if there is one factor on it that brings them all into their ranges and
leaves the usual values in theirs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sysid.campaign.factors import likely_unit
from sysid.numbers import listing

#: Explanations that are told, and how those begin that are all numbers of a key.
_MOST = 3
_ALL_OF = "all "


@dataclass(frozen=True)
class Declared:
    """A declared number: its key, which entry it belongs to in words, and its value in the unit of the key."""

    key: str
    of: str
    value: float

    @property
    def name(self) -> str:
        """Key and entry."""
        return f"{self.key} of {self.of}" if self.of else self.key


@dataclass(frozen=True)
class Derived:
    """A value that follows from declared numbers, in words: ``the tires of 'front' sink by``.

    `value`, `low` and `high` are in `unit`; `powers` by declared number.
    """

    what: str
    value: float
    low: float
    high: float
    unit: str
    powers: Mapping[Declared, float] = field(hash=False)

    @property
    def unusual(self) -> bool:
        """Whether the value is outside of its range."""
        return not self.low <= self.value <= self.high

    def factors(self, power: float) -> tuple[float, float]:
        """Logarithms of the factors on a number with this power that bring the value to the ends of its range."""
        ends = [math.log(end / self.value) / power if end > 0.0 else -math.inf * power for end in (self.low, self.high)]
        return min(ends), max(ends)

    @property
    def words(self) -> str:
        """The value, and what is usual."""
        low, high = (f"{float(f'{x:.3g}'):g}" for x in (self.low, self.high))
        end = (
            f"at most {high}" if self.low == 0.0 else f"at least {low}" if math.isinf(self.high) else f"{low} to {high}"
        )
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.what} {self.value:.3g}{unit}, {end} is usual"


@dataclass(frozen=True)
class _Explanation:
    """`numbers`, called `name` together; logarithms of the `factors` on them that are possible; what they explain."""

    numbers: tuple[Declared, ...]
    name: str
    factors: tuple[float, float]
    explained: tuple[int, ...]

    @property
    def unit(self) -> str:
        low, high = (math.exp(min(-f, 300.0)) for f in reversed(self.factors))
        return likely_unit(self.numbers[0].key, low, high)

    @property
    def words(self) -> str:
        likely = f", as if given {self.unit}" if self.unit else ""
        shown = self.numbers if len({n.key for n in self.numbers}) == 1 else ()
        values = f" ({listing([f'{n.value:g}' for n in shown])})" if shown else ""
        return f"{self.name}{values}{likely}"


def sentences(derived: Sequence[Derived], together: Sequence[tuple[str, Sequence[str]]] = ()) -> list[str]:
    """One sentence per cause of unusual values, with the numbers that explain them.

    Parameters
    ----------
    derived
        All values, usual ones too: what leaves these in their ranges is no explanation otherwise.
    together
        Keys that change together only, with what they are called: masses, whose sums have been checked.
    """
    left = [i for i, d in enumerate(derived) if d.unusual]
    said = []
    while left:
        found = [e for numbers in _candidates(derived, left, together) if (e := _explained(*numbers, derived, left))]
        if not found:
            said += [f"{derived[i].words}: check {listing([n.name for n in derived[i].powers])}." for i in left]
            break
        most = max(len(e.explained) for e in found)
        best = [e for e in found if len(e.explained) == most]
        # One number is likelier to be wrong than several.
        best = [e for e in best if len(e.numbers) == 1] or best
        best = [e for e in best if e.explained == best[0].explained]
        said.append(_sentence(best, [derived[i] for i in best[0].explained]))
        left = [i for i in left if i not in best[0].explained]
    return list(dict.fromkeys(said))


def _candidates(
    derived: Sequence[Derived], left: Sequence[int], together: Sequence[tuple[str, Sequence[str]]]
) -> list[tuple[str, tuple[Declared, ...]]]:
    """Every number of the unusual values by itself, all of its key, and keys that change together; with their names."""
    joined = {key for _, keys in together for key in keys}
    everywhere: dict[str, dict[Declared, None]] = {}
    for d in derived:
        for number in d.powers:
            everywhere.setdefault(number.key, {})[number] = None
    of_left = dict.fromkeys(n for i in left for n in derived[i].powers)
    free = [n for n in of_left if n.key not in joined]
    found: list[tuple[str, tuple[Declared, ...]]] = [(n.name, (n,)) for n in free]
    found += [(f"{_ALL_OF}{key}", tuple(everywhere[key])) for key in dict.fromkeys(n.key for n in free)]
    for name, keys in together:
        numbers = tuple(n for key in keys for n in everywhere.get(key, ()))
        found += [(name, numbers)] if any(n in of_left for n in numbers) else []
    return [(name, numbers) for name, numbers in found if len(numbers) > 1 or not name.startswith(_ALL_OF)]


def _explained(
    name: str, numbers: tuple[Declared, ...], derived: Sequence[Derived], left: Sequence[int]
) -> _Explanation | None:
    """The unusual values that one factor on these numbers explains, None where there is no such factor."""
    low, high = -math.inf, math.inf
    explained = []
    for i, d in enumerate(derived):
        power = sum(d.powers.get(n, 0.0) for n in numbers)
        if power == 0.0 or (d.unusual and i not in left):
            continue
        ends = d.factors(power)
        low, high = max(low, ends[0]), min(high, ends[1])
        if d.unusual:
            explained.append(i)
    return _Explanation(numbers, name, (low, high), tuple(explained)) if explained and low <= high else None


def _sentence(found: Sequence[_Explanation], unusual: Sequence[Derived]) -> str:
    worst = max(unusual, key=lambda d: abs(math.log(max(d.value, 1e-300) / (d.high if d.value > d.high else d.low))))
    more = f" (and {len(unusual) - 1} more such values)" if len(unusual) > 1 else ""
    told = [e.words for e in found[:_MOST]]
    return f"{'Either ' if len(told) > 1 else ''}{'; or '.join(told)}: {worst.words}{more}. Correct it."
