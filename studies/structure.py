"""Figures of the code's structure: sizes, circles of imports, and imports that cross inside the largest package.

    python -m studies.structure [ROOT]

ROOT is a checkout, by default this one, so that an earlier state can be measured by the same command.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

#: Longest function and largest package whose inner imports are counted.
LONG_FUNCTION = 60
LARGEST = "sysid.estimation"


def modules(root: Path) -> dict[str, ast.Module]:
    """Syntax trees of all modules of the package below `root`, by dotted name."""
    found = {}
    for path in sorted((root / "sysid").rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts)] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def imports(name: str, tree: ast.Module, known: set[str]) -> set[str]:
    """Modules of the package that a module imports, wherever in it."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return (found & known) - {name}


def definitions(tree: ast.Module, kind: type[ast.AST]) -> Iterator[tuple[int, str]]:
    """Lines, docstring not counted, and name of every definition of a kind."""
    for node in ast.walk(tree):
        if isinstance(node, kind) and isinstance(node, ast.FunctionDef | ast.ClassDef):
            words = ast.get_docstring(node, clean=False) or ""
            yield (node.end_lineno or node.lineno) - node.lineno + 1 - len(words.splitlines()), node.name


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other, directly or through others."""
    order = sorted(graph)
    place = {name: i for i, name in enumerate(order)}
    pairs = [(place[a], place[b]) for a in order for b in graph[a]]
    rows, columns = zip(*pairs, strict=True) if pairs else ((), ())
    matrix = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(order), len(order)))
    _, label = connected_components(matrix, directed=True, connection="strong")
    groups = [[name for name in order if label[place[name]] == k] for k in np.unique(label)]
    return [group for group in groups if len(group) > 1]


def report(root: Path) -> list[str]:
    """The figures as lines of text."""
    trees = modules(root)
    graph = {name: imports(name, tree, set(trees)) for name, tree in trees.items()}
    lines = {name: len((root / Path(*name.split("."))).with_suffix(".py").read_text().splitlines()) for name in trees}
    functions = [found for tree in trees.values() for found in definitions(tree, ast.FunctionDef)]
    classes = [found for tree in trees.values() for found in definitions(tree, ast.ClassDef)]
    inside = [name for name in trees if name.startswith(f"{LARGEST}.")]
    between = [(a, b) for a in inside for b in graph[a] if b in inside]
    rooms = {name: name.split(".")[2] if name.count(".") > 2 else "" for name in inside}
    crossing = [pair for pair in between if rooms[pair[0]] != rooms[pair[1]]]
    longest, largest = max(functions), max(classes)
    return [
        f"modules: {len(trees)}, lines: {sum(lines.values())}, longest module: {max(lines.values())} lines",
        f"functions above {LONG_FUNCTION} lines: {sum(n > LONG_FUNCTION for n, _ in functions)} "
        f"(longest {longest[0]}, {longest[1]}); largest class: {largest[0]} lines ({largest[1]})",
        f"{LARGEST}: {len(inside)} modules, {len(between)} imports between them, {len(crossing)} from room to room",
        f"circles of imports: {len(circles(graph))}",
        *(f"  {' <-> '.join(group)}" for group in circles(graph)),
    ]


if __name__ == "__main__":
    sys.stdout.write("\n".join(report(Path(sys.argv[1] if len(sys.argv) > 1 else "."))) + "\n")
