"""The documentation: every page is reachable, every link and picture exists, and the site builds without a warning."""

import re
from pathlib import Path

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(p.relative_to(DOCS) for p in DOCS.rglob("*.md"))
NAMES = re.compile(r"^\s*-\s(?:[^:\n]+:\s)?([\w/-]+\.md)$", re.MULTILINE)


def test_every_page_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    assert sorted(Path(name) for name in NAMES.findall(navigation)) == PAGES


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", *(f"docs/{p}" for p in PAGES)])
def test_links_and_pictures_exist(page: str):
    path = ROOT / page
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if not target.startswith(("http://", "https://")):
            assert (path.parent / target).exists(), target


def test_pictures_are_small():
    sizes = {p.name: p.stat().st_size for p in (DOCS / "images").iterdir()}
    assert len(sizes) == 5
    assert max(sizes.values()) <= 150_000


def test_every_public_package_has_a_page_of_reference():
    packages = {p.parent.name for p in (ROOT / "sysid").glob("*/__init__.py")} - {"cli"}
    assert packages <= {p.stem for p in (DOCS / "reference").glob("*.md")}


def test_the_site_builds_strictly(tmp_path: Path):
    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path / "site"), strict=True)
    build(config)
    assert "effective_profiles" in (tmp_path / "site" / "reference" / "road.html").read_text(encoding="utf-8")
    for path in (tmp_path / "site").rglob("*.html"):
        assert not re.search(r'<(?:script|link|img)[^>]+(?:src|href)="https?://', path.read_text(encoding="utf-8"))
