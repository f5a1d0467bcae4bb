"""Figures of the code's structure: sizes, circles of imports, crossing imports, and blocks that are written twice.

    python -m studies.structure [ROOT]

ROOT is a checkout, by default this one, so that an earlier state can be measured by the same command.
"""

from __future__ import annotations

import ast
import io
import keyword
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

#: Longest function and largest package whose inner imports are counted.
LONG_FUNCTION = 60
LARGEST = "sysid.estimation"
#: Lines in a row of function bodies that count as a repeated block; names, numbers and texts in them do not matter.
REPEATED = 6
#: Tokens of a line that only lists values or members: lists look alike and repeat nothing.
_LISTING = frozenset({"name", "number", "text", ",", ".", "=", "*", "**", "(", ")", "[", "]", ":"})
_LAYOUT = frozenset(
    {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
)


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


def _body_lines(tree: ast.Module) -> set[int]:
    """Lines of function bodies, without docstrings and imports."""
    inside: set[int] = set()
    outside: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            inside |= set(range(node.body[0].lineno, (node.end_lineno or 0) + 1))
            outside |= set(range(node.lineno, node.body[0].lineno))
        text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if isinstance(node, ast.stmt) and (text or isinstance(node, ast.Import | ast.ImportFrom)):
            outside |= set(range(node.lineno, (node.end_lineno or 0) + 1))
    return inside - outside


def shapes(source: str) -> list[tuple[int, str, str]]:
    """Number, shape and text of the lines of function bodies that do something."""
    bodies = _body_lines(ast.parse(source))
    lines: dict[int, list[tuple[str, str]]] = defaultdict(list)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in _LAYOUT or token.start[0] not in bodies:
            continue
        word = token.type == tokenize.NAME and not keyword.iskeyword(token.string)
        kind = {tokenize.NUMBER: "number", tokenize.STRING: "text"}.get(token.type, token.string)
        lines[token.start[0]].append(("name" if word else kind, token.string))
    result = []
    for line, tokens in lines.items():
        kinds, texts = zip(*tokens, strict=True)
        argument = not set(kinds) - _LISTING and kinds[-1] == ","
        if not argument and set(kinds) - {"(", ")", "[", "]", "{", "}", ","}:
            result.append((line, " ".join(kinds), " ".join(texts)))
    return result


def repeats(sources: dict[str, str], length: int = REPEATED) -> list[tuple[int, str, str, bool]]:
    """Blocks of lines of one shape: their length, both places, and whether their texts are the same as well."""
    known = {name: shapes(source) for name, source in sources.items()}
    starts: dict[tuple[str, ...], list[tuple[str, int]]] = defaultdict(list)
    for name, lines in known.items():
        for i in range(len(lines) - length + 1):
            starts[tuple(shape for _, shape, _ in lines[i : i + length])].append((name, i))
    pairs = {
        (a, i, b, j)
        for places in starts.values()
        for k, (a, i) in enumerate(places)
        for b, j in places[k + 1 :]
        if a != b or abs(i - j) >= length
    }
    result = []
    for a, i, b, j in sorted(pairs):
        if (a, i - 1, b, j - 1) in pairs:
            continue
        n = length
        while (a, i + n - length + 1, b, j + n - length + 1) in pairs:
            n += 1
        one, other = known[a][i : i + n], known[b][j : j + n]
        same = [text for _, _, text in one] == [text for _, _, text in other]
        result.append((n, f"{a}:{one[0][0]}", f"{b}:{other[0][0]}", same))
    return sorted(result, reverse=True)


def report(root: Path) -> list[str]:
    """The figures as lines of text."""
    trees = modules(root)
    graph = {name: imports(name, tree, set(trees)) for name, tree in trees.items()}
    sources = {name: (root / Path(*name.split("."))).with_suffix(".py").read_text(encoding="utf-8") for name in trees}
    lines = {name: len(source.splitlines()) for name, source in sources.items()}
    functions = [found for tree in trees.values() for found in definitions(tree, ast.FunctionDef)]
    classes = [found for tree in trees.values() for found in definitions(tree, ast.ClassDef)]
    inside = [name for name in trees if name.startswith(f"{LARGEST}.")]
    between = [(a, b) for a in inside for b in graph[a] if b in inside]
    rooms = {name: name.split(".")[2] if name.count(".") > 2 else "" for name in inside}
    crossing = [pair for pair in between if rooms[pair[0]] != rooms[pair[1]]]
    twice = repeats(sources)
    longest, largest = max(functions), max(classes)
    return [
        f"modules: {len(trees)}, lines: {sum(lines.values())}, longest module: {max(lines.values())} lines",
        f"functions above {LONG_FUNCTION} lines: {sum(n > LONG_FUNCTION for n, _ in functions)} "
        f"(longest {longest[0]}, {longest[1]}); largest class: {largest[0]} lines ({largest[1]})",
        f"{LARGEST}: {len(inside)} modules, {len(between)} imports between them, {len(crossing)} from room to room",
        f"circles of imports: {len(circles(graph))}",
        *(f"  {' <-> '.join(group)}" for group in circles(graph)),
        f"blocks of {REPEATED} lines written twice: {len(twice)}, {sum(same for *_, same in twice)} in the same words",
        *(f"  {n} lines {one} {other}{', the same words' * same}" for n, one, other, same in twice),
    ]


if __name__ == "__main__":
    sys.stdout.write("\n".join(report(Path(sys.argv[1] if len(sys.argv) > 1 else "."))) + "\n")
