"""A group of commands that is loaded when it is asked for: the help of all commands names it without."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import click


class LaterGroup(click.Group):
    """Stands for the group `name` of a module, and hands on to it whatever it is asked."""

    def __init__(self, module: str, name: str, help: str):
        super().__init__(name, help=help)
        self._module = module

    def whole(self) -> click.Group:
        """The group itself."""
        group: click.Group = getattr(import_module(self._module), str(self.name))
        return group

    def list_commands(self, context: click.Context) -> list[str]:
        """Names of the commands of the group."""
        return self.whole().list_commands(context)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """A command of the group by its name."""
        return self.whole().get_command(context, name)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """A context of the group, which then runs."""
        return self.whole().make_context(info_name, args, parent, **extra)
