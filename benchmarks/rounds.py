"""Interleaved rounds: contenders take turns, so that whatever else the machine does disturbs all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np


class Sample(NamedTuple):
    """Wall-clock and processor seconds of one piece of work; the latter sums over all threads."""

    wall_s: float
    processor_s: float


class Spread(NamedTuple):
    """Lower quartile, median and upper quartile of some rounds."""

    low: float
    middle: float
    high: float
    rounds: int


def spread(values: list[float]) -> Spread:
    """Quartiles of some values."""
    low, middle, high = np.percentile(values, [25.0, 50.0, 75.0])
    return Spread(float(low), float(middle), float(high), len(values))


@dataclass
class Contender:
    """One thing to be timed; `share` of the unit of work that one call does, for instance the number of sets.

    `every` : it takes part in every so many rounds.
    """

    name: str
    measure: Callable[[], Sample]
    share: float = 1.0
    every: int = 1
    samples: dict[int, Sample] = field(default_factory=dict)

    def per_unit(self, what: str) -> dict[int, float]:
        """Seconds per unit of work in every round; `what` is ``wall_s`` or ``processor_s``."""
        return {number: getattr(sample, what) / self.share for number, sample in self.samples.items()}


def timed(call: Callable[[], object], repeats: int = 1) -> Callable[[], Sample]:
    """A measurement of a call in this process."""

    def measure() -> Sample:
        wall, processor = time.perf_counter(), time.process_time()
        for _ in range(repeats):
            call()
        return Sample((time.perf_counter() - wall) / repeats, (time.process_time() - processor) / repeats)

    return measure


def run_rounds(contenders: list[Contender], rounds: int, limit_s: float) -> int:
    """Measure all contenders in turn, starting with another one in each round; the number of rounds done.

    After `limit_s` no further round is begun.
    """
    begin = time.perf_counter()
    for number in range(rounds):
        turn = number % len(contenders)
        for contender in contenders[turn:] + contenders[:turn]:
            if number % contender.every == 0:
                contender.samples[number] = contender.measure()
        if time.perf_counter() - begin > limit_s:
            return number + 1
    return rounds


def ratio(one: Contender, other: Contender, what: str) -> Spread:
    """How many times `one` takes as long as `other` per unit of work, over the rounds that both took part in."""
    first, second = one.per_unit(what), other.per_unit(what)
    return spread([first[k] / second[k] for k in first if k in second])
