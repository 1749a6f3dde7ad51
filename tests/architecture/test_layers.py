"""Arrows between packages point only inward, and each rule that says so can fail."""

import ast
import configparser
import re
import shutil
import subprocess
import sys
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[2]
AGENT_MAY_IMPORT = {"gslcosim.agent_kit", "gslcosim.contract", "gslcosim_search"}

# For each contract of .importlinter one import that breaks it, and where.
WRONG_ARROWS = {
    "Arrows point only inward": ("gslcosim_services/world/__init__.py", "import gslcosim_services.fields"),
    "The core imports no extension": ("gslcosim/validity/__init__.py", "import gslcosim_search"),
    "Extensions import only extensions below them": ("gslcosim_data/__init__.py", "import gslcosim_bench"),
    "What reads robots' logs stands over": ("gslcosim_data/run.py", "import gslcosim_data.film"),
    "What an agent's author imports": ("gslcosim_search/__init__.py", "import gslcosim.scenario"),
    "The framework knows no service": ("gslcosim/bus/__init__.py", "import gslcosim_services.radio"),
    "How processes start and end": (
        "gslcosim/runtime/processes/fork_server.py",
        "import gslcosim.runtime.distributed.service_main",
    ),
    "Zenoh has one home": ("gslcosim/runtime/__init__.py", "import zenoh"),
    "Rerun has one home": ("gslcosim/cli/__init__.py", "import rerun"),
    "MuJoCo has one home": ("gslcosim/environment/__init__.py", "from mujoco import mjtGeom"),
    "The gateway knows the contract and bytes": ("gslcosim/gateway/__init__.py", "import gslcosim.bus"),
    "Cores and contract know no clock": ("gslcosim_services/sensing/__init__.py", "from time import sleep"),
    "Figures of the benchmark": ("gslcosim_bench/metrics/__init__.py", "import gslcosim_bench.report"),
    "Rooms of the environment": ("gslcosim/environment/paths/__init__.py", "import gslcosim.environment.positions"),
    "Rooms of the fields": ("gslcosim_services/fields/filament/__init__.py", "import gslcosim_services.fields.models"),
    "The world: the core over": ("gslcosim_services/world/flight_space.py", "import gslcosim_services.world.scene"),
    "Rooms of search": ("gslcosim_search/motion/__init__.py", "import gslcosim_search.swarms"),
}


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    tool = Path(sys.executable).parent / "lint-imports"
    command = [str(tool), "--config", str(ROOT / ".importlinter"), "--no-logo", "--no-cache"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def lay_out(folder: Path) -> None:
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "gslcosim", folder / "gslcosim", ignore=ignore)
    shutil.copytree(ROOT / "services", folder / "gslcosim_services", ignore=ignore)
    for package in ROOT.glob("extensions/*/gslcosim_*"):
        shutil.copytree(package, folder / package.name, ignore=ignore)


def test_every_contract_is_broken_and_covers_every_extension():
    config = configparser.ConfigParser()
    config.read(ROOT / ".importlinter")
    names = [config[section]["name"] for section in config.sections() if ":contract:" in section]
    assert [name for name in names if not any(name.startswith(start) for start in WRONG_ARROWS)] == []
    packages = {path.name for path in ROOT.glob("extensions/*/gslcosim_*") if (path / "__init__.py").is_file()}
    assert set(config["importlinter"]["root_packages"].split()) == {"gslcosim", "gslcosim_services", *packages}
    assert set(config["importlinter:contract:core"]["forbidden_modules"].split()) == packages
    assert set(re.findall(r"\w+", config["importlinter:contract:extensions"]["layers"])) == packages


@pytest.mark.slow
def test_no_arrow_points_outward(tmp_path):
    lay_out(tmp_path)
    outcome = lint_imports(tmp_path)
    assert outcome.returncode == 0, outcome.stdout


@pytest.mark.slow
def test_every_rule_finds_an_arrow_that_breaks_it(tmp_path):
    lay_out(tmp_path)
    for file, wrong in WRONG_ARROWS.values():
        path = tmp_path / file
        path.write_text(f"{path.read_text()}\n{wrong}\n")
    report = " ".join(lint_imports(tmp_path).stdout.split())
    contracts = report.split("Broken contracts")[0]
    for name in WRONG_ARROWS:
        after = contracts.split(name)[1]
        assert "BROKEN" in after.split("KEPT")[0], f"{name} was kept"


def imports_of(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(node.module or "")
    return names


def is_within(module: str, packages: set[str]) -> bool:
    return any(module == package or module.startswith(f"{package}.") for package in packages)


def circles_of(imports: dict[str, set[str]]) -> list[str]:
    """Modules that cannot be put in an order in which each imports earlier ones only."""
    left = dict(imports)
    while free := [module for module, imported in left.items() if not imported & left.keys()]:
        for module in free:
            del left[module]
    return sorted(left)


def test_modules_of_the_runtime_import_each_other_in_no_circle():
    """Imports within functions and those for types count too."""
    graph = grimp.build_graph("gslcosim", cache_dir=None)
    modules = {module for module in graph.modules if module.startswith("gslcosim.runtime.")}
    imports = {module: graph.find_modules_directly_imported_by(module) & modules for module in modules}
    assert len(modules) > 30
    assert circles_of(imports) == []
    assert circles_of({"a": {"b"}, "b": {"a"}, "c": {"a"}, "d": set()}) == ["a", "b", "c"]


def test_bundled_agents_see_only_the_kit_and_the_contract():
    for path in ROOT.glob("agents/*/**/*.py"):
        ours = {name for name in imports_of(path) if name.split(".")[0].startswith("gslcosim")}
        assert {name for name in ours if not is_within(name, AGENT_MAY_IMPORT)} == set(), path


def test_the_framework_never_imports_an_agent():
    for path in ROOT.glob("gslcosim/**/*.py"):
        assert not {name for name in imports_of(path) if name.startswith("gslcosim_agents.")}, path
