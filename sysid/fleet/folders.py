"""Finds the campaigns below the folder of a fleet: every folder once, through links too, with a word on what is not."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from sysid.wording import shorten

CAMPAIGN_FILE = "campaign.toml"
#: Depth below the fleet's folder in which campaign files are looked for.
_DEPTH = 4


def campaign_folders(folder: Path) -> tuple[list[str], list[str]]:
    """Folders with a campaign file below `folder`, relative to it, in order of their names; and what was left out.

    Links to folders are followed.  A folder that can be reached by several names is taken once, without a link if
    there is such a name.  What was left out is one sentence each.
    """
    search = _Search(folder)
    search.run()
    return sorted(search.campaigns), search.said


class _Search:
    """`campaigns` found so far, sentences `said`, and the names by which folders were `seen` by their real path."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.campaigns: list[str] = []
        self.said: list[str] = []
        self.seen: dict[str, Path] = {}
        #: Links wait until what can be reached without them has been seen.
        self.links: list[Path] = []

    def run(self) -> None:
        self.walk(self.folder)
        top = Path(os.path.realpath(self.folder))
        for link in self.links:
            real = os.path.realpath(link)
            if top.is_relative_to(real):
                self.say(link, "is left out: the link leads back to the folder of the fleet, or above it")
            elif real in self.seen:
                self.say(link, f"is left out: the link leads to {self.name(self.seen[real])}")
            else:
                self.walk(link)

    def walk(self, start: Path) -> None:
        for root, folders, files in os.walk(start, onerror=self.unread):
            here, real = Path(root), os.path.realpath(root)
            # Below a link there may be what is seen already.
            folders[:] = [] if real in self.seen else self.look(here, sorted(folders), files)
            self.seen.setdefault(real, here)

    def look(self, here: Path, folders: list[str], files: list[str]) -> list[str]:
        """Take a folder if it holds a campaign; which of its subfolders to look into next."""
        is_campaign = CAMPAIGN_FILE in files and here != self.folder
        if is_campaign:
            self.take(here)
        elif "stages" in folders:
            # Results of earlier runs hold no campaign files, but may hold thousands of folders.
            return []
        else:
            for name in self.broken_links(here, files):
                self.say(here / name, "is a link to nothing; restore what it leads to, or remove it")
        further: list[Path] = []
        for name in folders:
            why = self.why_not(here, name, is_campaign)
            if why and os.path.isfile(here / name / CAMPAIGN_FILE):
                self.say(here / name, f"is left out: {why}")
            elif not why:
                (self.links if os.path.islink(here / name) else further).append(here / name)
        return [path.name for path in further]

    def take(self, here: Path) -> None:
        name = here.relative_to(self.folder).as_posix()
        try:
            name.encode()
        except UnicodeEncodeError:
            self.say(here, "is left out: its name is not UTF-8; rename it")
        else:
            self.campaigns.append(name)

    def why_not(self, here: Path, name: str, is_campaign: bool) -> str:
        """Why a subfolder is not looked into; empty if it is."""
        if is_campaign:
            return "it is inside of another campaign"
        if name.startswith("."):
            return "its name begins with a dot"
        too_deep = len(here.relative_to(self.folder).parts) >= _DEPTH
        return f"it is more than {_DEPTH} folders deep" if too_deep else ""

    def broken_links(self, here: Path, files: list[str]) -> Iterator[str]:
        for name in sorted(files):
            path = here / name
            if not name.startswith(".") and os.path.islink(path) and not os.path.exists(path):
                yield name

    def unread(self, error: OSError) -> None:
        self.say(Path(error.filename), f"cannot be read ({error.strerror}); look at its rights")

    def name(self, path: Path) -> str:
        return shorten(path.relative_to(self.folder), 100)

    def say(self, path: Path, what: str) -> None:
        self.said.append(f"{self.name(path)} {what}.")
