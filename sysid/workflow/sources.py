"""The code behind a stage's numbers: a hash of the sources of the packages that it uses.

For releases the version of this package would be enough. Between releases, in a checkout that is edited or pulled,
numbers change while the version stays. So the sources are hashed too: those of the packages that a stage's record names
in `code`, and of all packages that these import. Comments, docstrings and layout do not count: a Python file is hashed
by its syntax tree without them, and that hash kept beside compiled code. The hash is sound as far as imports show what
is used, and errs on the safe side: any change of code in a package makes all stages stale that reach it. What the
version covers alone is the workflow's own code, whose compute functions only hand settings and results on.
"""

from __future__ import annotations

import ast
import hashlib
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path

from sysid.private_files import NotPrivateError, check_private, write_private
from sysid.runtime import private_cache

ROOT = Path(__file__).resolve().parents[1]
_IMPORT = re.compile(rb"^\s*(?:from|import)\s+sysid\.(\w+)", re.MULTILINE)
_FROM_ROOT = re.compile(rb"^\s*from\s+sysid\s+import\s+([\w, ]+)", re.MULTILINE)


def code_digest(packages: Iterable[str]) -> str:
    """Hash of the sources of packages (or single modules) of `sysid` and of all that they import."""
    digest, before = hashlib.sha256(), len(_stored_hashes())
    for name in sorted(imported_by(packages)):
        digest.update(name.encode() + _hash_and_imports(name)[0])
    if len(_stored_hashes()) > before:
        _store_hashes()
    return digest.hexdigest()


def imported_by(packages: Iterable[str]) -> set[str]:
    """Names of packages and of everything that they import within `sysid`, directly or not."""
    imported: set[str] = set()
    left = set(packages)
    while left:
        name = left.pop()
        imported.add(name)
        left |= _hash_and_imports(name)[1] - imported
    return imported


def _hash_file() -> Path:
    """The file of hashes: pairs of 32 bytes, of a text and of its meaning in this version of Python."""
    return private_cache("sources") / f"{sys.implementation.cache_tag}.hashes"


@cache
def _stored_hashes() -> dict[bytes, bytes]:
    """Hashes of what is meant, by those of texts: reading all files anew takes a second or two."""
    try:
        check_private(_hash_file())
        content = _hash_file().read_bytes()
    except (NotPrivateError, OSError):
        return {}
    return {content[i : i + 32]: content[i + 32 : i + 64] for i in range(0, len(content), 64)}


def _store_hashes() -> None:
    # Two processes that write at once leave files that do not fit each other, which are not read.
    with suppress(NotPrivateError, OSError):
        for file in (_hash_file(), _hash_file().with_name(f"{_hash_file().name}.sha256")):
            file.unlink(missing_ok=True)
        write_private(_hash_file(), b"".join(text + meaning for text, meaning in _stored_hashes().items()))


@cache
def _hash_and_imports(name: str) -> tuple[bytes, frozenset[str]]:
    """Hash of the sources of one package or module, and which others it imports."""
    folder, module = ROOT / name, ROOT / f"{name}.py"
    files = [p for p in folder.rglob("*") if p.suffix in (".py", ".cpp", ".h")] if folder.is_dir() else [module]
    digest = hashlib.sha256()
    imported: set[str] = set()
    for path in sorted(files):
        if not path.is_file():
            continue
        text = path.read_bytes()
        digest.update(path.relative_to(ROOT).as_posix().encode() + _meaning(path, text))
        imported |= {match.decode() for match in _IMPORT.findall(text)}
        for names in _FROM_ROOT.findall(text):
            imported |= {part.split()[0] for part in names.decode().split(",") if part.split()}
    known = {n for n in imported if (ROOT / n).is_dir() or (ROOT / f"{n}.py").is_file()}
    return digest.digest(), frozenset(known - {name})


def _meaning(path: Path, text: bytes) -> bytes:
    """Hash of the parts of a source file that determine its effect; for Python, as stored for this text and version."""
    of_text = hashlib.sha256(text).digest()
    if path.suffix != ".py":
        return of_text
    known = _stored_hashes()
    if of_text not in known:
        known[of_text] = hashlib.sha256(_without_words(text)).digest()
    return known[of_text]


def _without_words(text: bytes) -> bytes:
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return ast.dump(tree).encode()
