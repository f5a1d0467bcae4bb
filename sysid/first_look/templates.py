"""Vehicles to begin with: tables of a campaign file with typical numbers, which are assumptions."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from sysid.errors import CampaignError
from sysid.first_look.words import Beside, PlaceWord, place_word, tokens
from sysid.wording import finish, nearest


@dataclass(frozen=True)
class Template:
    """A vehicle: its `name`, where its numbers come from, and its tables as in a campaign file.

    `load_cases` has the cases ``empty`` and ``laden``.
    """

    name: str
    source: str
    vehicle: Mapping[str, Any]
    load_cases: Mapping[str, Mapping[str, Any]]

    @property
    def axles(self) -> list[dict[str, Any]]:
        """Tables of the axles, front to rear."""
        return sorted(self.vehicle["axle"], key=lambda axle: float(axle["x_m"]))

    @property
    def positions_m(self) -> tuple[float, ...]:
        """Distances behind axle 1 [m]."""
        return tuple(float(axle["x_m"]) for axle in self.axles)

    @property
    def places(self) -> tuple[PlaceWord | None, ...]:
        """Word for the place of every axle, from its name."""
        names = [tokens(str(axle["name"])) for axle in self.axles]
        return tuple(place_word(words, Beside(names)) for words in names)


def template_names() -> tuple[str, ...]:
    """Names of all templates."""
    return tuple(sorted(p.name.removesuffix(".toml") for p in _folder().iterdir() if p.name.endswith(".toml")))


def template(name: str) -> Template:
    """The template of this name.

    Raises
    ------
    CampaignError
        If there is none; the nearest name is suggested.
    """
    text = template_text(name)
    tables = tomllib.loads(text)
    source = " ".join(line.lstrip("# ") for line in text.splitlines() if line.startswith("#"))
    return Template(name, source, tables["vehicle"], tables["load_case"])


def template_text(name: str) -> str:
    """The text of a template.

    Raises
    ------
    CampaignError
        If there is none of this name; the nearest name is suggested.
    """
    if name not in template_names():
        raise CampaignError(finish(f"There is no vehicle '{name[:60]}'; {nearest(name, template_names())}"))
    return str((_folder() / f"{name}.toml").read_text(encoding="utf-8"))


def _folder() -> Any:
    return files("sysid.first_look") / "vehicles"
