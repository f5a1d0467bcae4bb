"""Imports run downward only, and the light packages load nothing heavy: from the source, and from a fresh process."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import subprocess
import sys
import typing
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

import sysid

ROOT = Path(sysid.__file__).resolve().parent

#: From the bottom up; packages on one level do not know each other.
LEVELS = (
    {"errors", "limits", "version"},
    {"arrays", "files", "helper_child", "known_results", "private_files", "progress", "read_worker", "wording"},
    {
        "array_file",
        "bounded_reader",
        "cell_progress",
        "csv_cells",
        "display",
        "folder_lock",
        "numbers",
        "output_folder",
        "runtime",
        "threads",
    },
    {"helper_process", "tabular"},
    {"logs"},
    {"campaign"},
    {"bridge", "sdof", "road"},
    {"bookkeeping"},
    {"first_look", "vehicle_model"},
    {"estimation"},
    {"posterior"},
    {"balance", "prediction", "selftest", "validation"},
    {"planning", "estimates"},
    {"plot", "results"},
    {"export"},
    {"report"},
    {"workflow"},
    {"comparison", "fleet", "watch"},
    {"cli"},
    {"__main__"},
)
LEVEL = {name: number for number, names in enumerate(LEVELS) for name in names}

#: The rooms of the largest packages, from the bottom up.
ROOMS = {
    "campaign": ("toml", "passage", "inputs", "quality", "clocks"),
    "estimation": ("parameters", "residuals", "weights", "uncertainty", "fit"),
}
#: Files of such a package outside its rooms.
NO_ROOM = {
    "campaign": {
        "bridges",
        "bump_shapes",
        "changed",
        "clipping",
        "declared",
        "factors",
        "findings",
        "gaps",
        "loggers",
        "mass_sums",
        "priors",
        "read",
        "records",
        "requests",
        "roads",
        "sensor_kinds",
        "statics",
        "units",
        "vehicle_records",
        "wheel_places",
        "zero_phase",
    }
}

JAX_PACKAGES = {"runtime", "vehicle_model", "estimation", "posterior", "prediction", "planning", "estimates"}


def imported_modules(source: str, package: str) -> set[str]:
    """Absolute names of everything a module imports, inside functions too; relative imports resolved in `package`."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")
            base = ".".join(parts[: len(parts) - node.level + 1]) if node.level else ""
            origin = ".".join(p for p in (base, node.module or "") if p)
            found.add(origin)
            # `from sysid import road` names a package, not an attribute.
            found |= {f"{origin}.{alias.name}" for alias in node.names}
    return found


def layer(path: Path) -> str:
    """The package (or single module) directly under `sysid` that a file belongs to."""
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def targets(modules: set[str]) -> set[str]:
    """Names directly under `sysid` among imported modules."""
    return {m.split(".")[1] for m in modules if m.startswith("sysid.")} & set(LEVEL)


def upward(own: str, modules: set[str]) -> set[str]:
    """Imports that do not run downward from package `own`."""
    return {t for t in targets(modules) if t != own and LEVEL[t] >= LEVEL[own]}


SOURCES = sorted(p for p in ROOT.rglob("*.py") if p != ROOT / "__init__.py")


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_downward(path: Path):
    own = layer(path)
    assert own in LEVEL, f"{own} has no place among the layers"
    package = ".".join(["sysid", *path.relative_to(ROOT).parts[:-1]])
    modules = imported_modules(path.read_text(encoding="utf-8"), package)
    assert upward(own, modules) == set()
    roots = {m.split(".")[0] for m in modules}
    if own not in ("plot", "report"):
        assert "matplotlib" not in roots
    if own not in JAX_PACKAGES:
        assert roots & {"jax", "optimistix", "equinox"} == set()


@pytest.mark.parametrize(("package", "rooms"), ROOMS.items())
def test_rooms_import_downward(package: str, rooms: tuple[str, ...]):
    folder = ROOT / package
    assert {p.name for p in folder.iterdir() if p.is_dir() and p.name != "__pycache__"} == set(rooms)
    assert {p.stem for p in folder.glob("*.py")} == {"__init__"} | NO_ROOM.get(package, set())
    for number, room in enumerate(rooms):
        for path in sorted((folder / room).glob("*.py")):
            modules = imported_modules(path.read_text(encoding="utf-8"), f"sysid.{package}.{room}")
            above = {f"sysid.{package}.{higher}" for higher in rooms[number + 1 :]} | {f"sysid.{package}"}
            assert not {
                m for m in modules if m in above or m.startswith(tuple(f"{a}." for a in above - {f"sysid.{package}"}))
            }


def test_no_two_files_import_each_other():
    """Nor do three in a ring: what only type checkers read counts too."""
    names = {".".join(("sysid", *p.relative_to(ROOT).with_suffix("").parts)): p for p in SOURCES}
    imports = {}
    for name, path in names.items():
        modules = imported_modules(path.read_text(encoding="utf-8"), name.rsplit(".", 1)[0])
        # A package's __init__ only hands names on.
        imports[name] = (modules & names.keys()) - {name}
    assert circles(imports) == []


def circles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that reach each other."""
    order = sorted(imports)
    index = {name: i for i, name in enumerate(order)}
    rows, columns = zip(*[(index[a], index[b]) for a in order for b in imports[a]], strict=True)
    graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(order), len(order)))
    count, label = connected_components(graph, directed=True, connection="strong")
    groups = [[name for name in order if label[index[name]] == k] for k in range(count)]
    return [group for group in groups if len(group) > 1]


def test_a_circle_is_seen():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]


#: What figures and report may use when they run, besides each other and the exports: records, constants and words.
SHOWN = {
    "balance.evidence",
    "campaign.findings",
    "csv_cells",
    "display",
    "estimates.suspension_values",
    "estimation.fit.thresholds",
    "files",
    "helper_process",
    "numbers",
    "results.contents",
    "results.judgement",
    "results.headline",
    "results.next_steps",
    "results.pass_limits",
    "results.worst_effects",
    "sdof.drop_results",
    "validation.channel_agreement",
    "wording",
}


def runtime_imports(tree: ast.Module, package: str) -> set[str]:
    """Modules of `sysid` that a module imports when it runs: those for type checkers alone are left out."""
    body = [n for n in tree.body if not (isinstance(n, ast.If) and getattr(n.test, "id", "") == "TYPE_CHECKING")]
    found = imported_modules(ast.unparse(ast.Module(body, [])), package)
    return {
        m.removeprefix("sysid.") for m in found if (ROOT / f"{m.removeprefix('sysid.').replace('.', '/')}.py").is_file()
    }


def checked_names(tree: ast.Module) -> list[tuple[str, str]]:
    """(module, name) of what a module imports for type checkers alone, from `sysid`."""
    guards = [n for n in tree.body if isinstance(n, ast.If) and getattr(n.test, "id", "") == "TYPE_CHECKING"]
    lines = [line for guard in guards for line in guard.body if isinstance(line, ast.ImportFrom)]
    return [(str(n.module), a.name) for n in lines if str(n.module).startswith("sysid.") for a in n.names]


DRAWN = [p for p in SOURCES if layer(p) in ("plot", "report")]


@pytest.mark.parametrize("path", DRAWN, ids=lambda p: str(p.relative_to(ROOT)))
def test_figures_and_report_compute_nothing(path: Path):
    """They use results that are there; of packages that compute they know the records, and those by name only."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    package = ".".join(["sysid", *path.relative_to(ROOT).parts[:-1]])
    used = {m for m in runtime_imports(tree, package) if not m.startswith(("plot.", "report.", "export."))}
    assert used <= SHOWN
    # A package's __init__ hands on names of its own.
    of_others = [found for found in checked_names(tree) if not found[0].startswith(f"{package}.")]
    for module, name in of_others if path.name == "__init__.py" else checked_names(tree):
        kind = getattr(importlib.import_module(module), name)
        assert dataclasses.is_dataclass(kind) or typing.get_origin(kind) is typing.Literal, f"{name} is no record"


def test_a_figure_that_computes_is_seen():
    source = "from sysid.prediction.predict_passes import predict\nif TYPE_CHECKING:\n    from sysid.road import scan\n"
    tree = ast.parse(source)
    assert runtime_imports(tree, "sysid.plot") == {"prediction.predict_passes"}
    assert checked_names(tree) == [("sysid.road", "scan")]


@pytest.mark.parametrize(
    ("own", "source"),
    [
        ("road", "def f():\n    from sysid.vehicle_model import contact\n"),
        ("road", "import sysid.sdof.drop_results\n"),
        ("estimation", "if TYPE_CHECKING:\n    from sysid import posterior\n"),
        ("campaign", "from ..report import page\n"),
    ],
)
def test_an_upward_import_is_seen(own: str, source: str):
    assert upward(own, imported_modules(source, f"sysid.{own}")) != set()


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import sysid", ("matplotlib", "emcee", "jax", "numpy", "pandas")),
        ("from sysid.campaign import *", ("matplotlib", "emcee", "jax")),
        ("from sysid.sdof import *; from sysid.road import *", ("matplotlib", "emcee", "jax")),
        ("from sysid.plot import *; from sysid.estimates import *", ("emcee", "jax", "pandas", "scipy")),
        ("from sysid.vehicle_model import *; from sysid.estimation import *", ("matplotlib", "emcee")),
        # What the process that helps to draw is given.
        ("import sysid.report.paper_figures, sysid.estimation.fit.fit_result", ("emcee", "jax", "pandas")),
        (
            "import sysid.planning.advice_records, sysid.prediction.predicted_passes",
            ("emcee", "jax", "pandas", "scipy"),
        ),
        ("import sysid.vehicle_model.vibration_modes, sysid.road.effective", ("emcee", "jax", "pandas")),
        ("import sysid.posterior.sampled_posterior", ("emcee", "jax", "pandas", "scipy")),
        # What `check` needs.
        ("import sysid.bookkeeping.check; from sysid.workflow import Calibration", ("emcee", "jax", "matplotlib")),
    ],
)
def test_light_packages_load_nothing_heavy(statement: str, absent: tuple[str, ...]):
    code = f"import sys\n{statement}\nprint(*sorted(set({absent!r}) & sys.modules.keys()))"
    result = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == ""


def test_check_in_a_new_folder_loads_nothing_heavy(tmp_path: Path):
    code = (
        "import sys\n"
        "from sysid.cli.main import cli\n"
        "from sysid.runtime import own_process\n"
        "own_process()\n"
        "try:\n"
        f"    cli(['check', {str(ROOT.parent / 'examples/linear_truck')!r}, '--output', {str(tmp_path)!r}])\n"
        "except SystemExit as end:\n"
        "    heavy = 'jax', 'optimistix', 'emcee', 'matplotlib', 'pint', 'scipy.signal', 'scipy.stats'\n"
        "    print('ends with', end.code, *sorted(set(heavy) & sys.modules.keys()))\n"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.splitlines()[-1] == "ends with 0"
    assert (tmp_path / "result.json").is_file()


def test_test_modules_have_names_of_their_own():
    """Pytest imports them by their bare names: two of one name cannot be collected in one run."""
    names = [p.name for p in Path(__file__).parent.rglob("test_*.py")]
    assert sorted({n for n in names if names.count(n) > 1}) == []
