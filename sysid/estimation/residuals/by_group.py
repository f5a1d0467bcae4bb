"""Campaigns with many readings, group by group: derivatives of the residuals of all runs would fill the memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar, overload

from sysid import limits
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.threads import side_by_side

T = TypeVar("T")

#: Groups that are in memory at the same time where not all fit.
AT_ONCE = 2


class ByGroup(Sequence[T]):
    """One result per group, computed when it is asked for and not kept."""

    def __init__(self, count: int, make: Callable[[int], T]):
        """`make` gives the result of the group at a position."""
        self._count, self._make = count, make

    def __len__(self) -> int:
        """Number of groups."""
        return self._count

    @overload
    def __getitem__(self, position: int) -> T: ...

    @overload
    def __getitem__(self, position: slice) -> Sequence[T]: ...

    def __getitem__(self, position: int | slice) -> T | Sequence[T]:
        """The result of one group, or of some."""
        if isinstance(position, slice):
            return [self._make(k) for k in range(*position.indices(self._count))]
        if not 0 <= position < self._count:
            raise IndexError(position)
        return self._make(position)


def too_many(model: BumpModel, numbers: int) -> bool:
    """Whether so many numbers for every reading are more than may be held at a time."""
    readings = sum(group.value.size for group in model.groups)
    return len(model.groups) > 1 and 8 * readings * numbers > limits.DERIVATIVES_BYTES


def each_group(function: Callable[[int], T], groups: int) -> tuple[T, ...]:
    """Results of a function of the position for all groups; at most :data:`AT_ONCE` at the same time."""
    return side_by_side(function, range(groups), at_most=AT_ONCE)
