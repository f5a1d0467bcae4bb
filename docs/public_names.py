"""Public names of a package for the pages of its reference: ``from .module import name as name`` in its stub."""

import ast
from typing import Any

import griffe


class PublicNames(griffe.Extension):
    """Griffe takes imported names for private unless they are listed a second time."""

    def on_alias_instance(self, *, node: Any, alias: griffe.Alias, **_: Any) -> None:
        """Mark a name that is imported under its own name."""
        if isinstance(node, ast.ImportFrom) and any(a.asname == a.name == alias.name for a in node.names):
            alias.public = True
