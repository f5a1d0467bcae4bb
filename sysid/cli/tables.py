"""Prints what the records of the stages say is shown, in the width of the terminal."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sysid.cli.invocation import next_command
from sysid.display import CommandHint, TextTable
from sysid.wording import plain_text
from sysid.workflow.stage import Blocks

#: Narrowest column of names or words.
_NARROW = 12
#: Columns of blanks between two columns of a table.
_GAP = 2


def plain_table(title: str, columns: Sequence[str]) -> Table:
    """A table without lines; the first column to the left, the others to the right."""
    table = Table(title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right")
    return table


def render(screen: Console, blocks: Blocks) -> None:
    """Print tables and sentences; names that users chose are never taken for markup."""
    for block in blocks:
        if isinstance(block, TextTable):
            screen.print(fitted_table(block, screen.width))
        elif isinstance(block, CommandHint):
            show_command(screen, block.text, next_command(*block.command))
        else:
            screen.print(block, markup=False)


def show_command(screen: Console, text: str, command: str) -> None:
    """A sentence and below it a command, in one piece however narrow the terminal is, so that it can be pasted."""
    screen.print(f"{text}:", markup=False)
    screen.print(f"  {command}", markup=False, soft_wrap=True)


def fitted_table(block: TextTable, width: int) -> Table:
    """A table no wider than `width`: names lose their middle, sentences wrap, numbers stay whole."""
    columns = [[plain_text(row[i]) for row in block.rows] for i in range(len(block.columns))]
    least = [max([_NARROW if _is_text(cells) else _widest(cells), *map(len, head.split())])
             for head, cells in zip(block.columns, columns, strict=True)]  # fmt: skip
    wanted = [max(_widest(cells), len(head)) for head, cells in zip(block.columns, columns, strict=True)]
    free = width - _GAP * (len(wanted) - 1)
    while sum(wanted) > free and any(w > m for w, m in zip(wanted, least, strict=True)):
        # Heads wrap before names are cut, and the widest column gives first.
        room = [w - m for w, m in zip(wanted, least, strict=True)]
        number = [i for i, cells in enumerate(columns) if not _is_text(cells) and room[i] > 0]
        widest = max(number or range(len(wanted)), key=lambda i: (room[i] > 0, wanted[i]))
        wanted[widest] -= 1
    table = plain_table(escape(block.title), ())
    for i, (head, cells) in enumerate(zip(block.columns, columns, strict=True)):
        to_the_left = i == 0 or (_is_text(cells) and any(" " in cell for cell in cells) and _widest(cells) > wanted[i])
        table.add_column(escape(head), justify="left" if to_the_left else "right", min_width=wanted[i],
                         max_width=wanted[i])  # fmt: skip
        if _is_text(cells) and not any(" " in cell for cell in cells):
            columns[i] = short_names(cells, wanted[i])
    for row in zip(*columns, strict=True):
        table.add_row(*map(escape, row))
    return table


def short_names(names: Sequence[str], width: int) -> list[str]:
    """Names of at most `width` characters that differ where the names do, as far as there is room for it.

    What all share at the beginning goes first, then the ends of long words (numbers stay), then the middle.
    """
    if _widest(names) <= width:
        return list(names)
    shapes = [list(names), _without_beginning(names, "/"), _without_beginning(names, "")]
    shapes += [[_short_words(name, letters) for name in shapes[-1]] for letters in range(12, 1, -1)]
    shapes = [shape for shape in shapes if _widest(shape) <= width]
    shapes += [[_without_middle(n, width, tail) for n in names] for tail in _tails(width)]
    return max(shapes, key=lambda shape: len(set(shape)))


def _without_beginning(names: Sequence[str], separator: str) -> list[str]:
    """Names without the words, or folders, with which all begin; an ellipsis stands for words."""
    given = {n for n in names if n}
    first, last = (min(given), max(given)) if len(given) > 1 else ("", "")
    shared = first[: next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))]
    shared = shared[: shared.rfind("/") + 1] if separator else re.sub(r"[^\W_]+$", "", shared)
    instead = "" if separator or not shared else "\N{HORIZONTAL ELLIPSIS}"
    return [instead + n[len(shared) :] if n else n for n in names]


def _short_words(name: str, letters: int) -> str:
    return re.sub(r"[^\W\d_]+", lambda word: word[0][:letters], name)


def _tails(width: int) -> list[int]:
    """Lengths of a tail to try, half of the width first."""
    return sorted(range(1, max(2, width - 1)), key=lambda tail: abs(tail - width // 2))


def _without_middle(name: str, width: int, tail: int) -> str:
    return name if len(name) <= width else f"{name[: width - 1 - tail]}\N{HORIZONTAL ELLIPSIS}{name[-tail:]}"


def _widest(cells: Sequence[str]) -> int:
    return max(map(len, cells), default=0)


def _is_text(cells: Sequence[str]) -> bool:
    """Whether a column holds names or words that are longer than the narrowest column, and no numbers."""
    return _widest(cells) > _NARROW and any(sum(c.isalpha() for c in cell) > len(cell) // 2 for cell in cells)
