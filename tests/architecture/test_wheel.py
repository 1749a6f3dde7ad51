"""Wheels of core and extensions hold all that runs need, under unambiguous names."""

import shutil
import subprocess
import sys
import zipfile
from itertools import chain
from pathlib import Path

import pytest
from distributions import CORE, ROOT, find_folder, list_needed, read_projects
from packaging.requirements import Requirement

import gslcosim

PROJECTS = read_projects()
CORE_FOLDERS = {
    "gslcosim": "gslcosim",
    "services": "gslcosim_services",
    "agents": "gslcosim_agents",
    "scenarios": "gslcosim_scenarios",
}
NOT_SHIPPED = {".pyc", ".rrd"}


def list_folders(name: str) -> dict[Path, str]:
    """Return the folders of packages of a distribution and their import names."""
    if name == CORE:
        return {ROOT / folder: package for folder, package in CORE_FOLDERS.items()}
    package = name.replace("-", "_")
    return {find_folder(name) / package: package}


@pytest.fixture(scope="session")
def wheels(tmp_path_factory) -> dict[str, Path]:
    """Wheels of all distributions, built from copies, so that nothing is left behind in the checkout."""
    built, out = {}, tmp_path_factory.mktemp("wheels")
    for name in PROJECTS:
        folder, copy = find_folder(name), tmp_path_factory.mktemp("source")
        for package in list_folders(name):
            ignored = shutil.ignore_patterns("__pycache__", "target", "node_modules")
            shutil.copytree(package, copy / package.name, ignore=ignored)
        for file in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
            if (folder / file).is_file():
                shutil.copy(folder / file, copy / file)
        command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(copy)]
        outcome = subprocess.run(command, capture_output=True, text=True, check=False)
        assert outcome.returncode == 0, outcome.stdout + outcome.stderr
        (built[name],) = out.glob(f"{name.replace('-', '_')}-{gslcosim.__version__}-*.whl")
    return built


def read_names(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.mark.slow
@pytest.mark.parametrize("name", PROJECTS)
def test_every_file_of_a_package_is_in_the_wheel(wheels, name):
    expected = {
        f"{package}/{path.relative_to(folder).as_posix()}"
        for folder, package in list_folders(name).items()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix not in NOT_SHIPPED
    }
    assert expected - read_names(wheels[name]) == set()


@pytest.mark.slow
@pytest.mark.parametrize("name", PROJECTS)
def test_a_wheel_brings_no_other_top_level_names(wheels, name):
    top = {each.split("/")[0] for each in read_names(wheels[name])}
    assert {each for each in top if not each.endswith(".dist-info")} == set(list_folders(name).values())


@pytest.mark.slow
@pytest.mark.parametrize("name", PROJECTS)
def test_a_wheel_has_the_licence(wheels, name):
    assert any(each.endswith(".dist-info/licenses/LICENSE") for each in read_names(wheels[name]))


@pytest.mark.slow
def test_the_wheel_of_the_core_has_the_command(wheels):
    assert any(name.endswith(".dist-info/entry_points.txt") for name in read_names(wheels[CORE]))


@pytest.mark.parametrize("name", PROJECTS)
def test_distributions_have_one_version(name):
    """`make version V=VERSION` writes it wherever it stands."""
    project = PROJECTS[name]
    required = [*project.get("dependencies", []), *chain.from_iterable(project["optional-dependencies"].values())]
    ours = [Requirement(each) for each in required if each.startswith(CORE)]
    named = [each for each in ours if each.name != name]
    if name != CORE:
        assert project["version"] == gslcosim.__version__
        assert CORE in {each.name for each in named}
    assert {str(each.specifier) for each in named} <= {f"=={gslcosim.__version__}"}


@pytest.mark.parametrize("name", [name for name in PROJECTS if name != CORE])
def test_an_extension_offers_the_extras_that_make_installs(name):
    assert {"dev", "check", "test-all"} <= PROJECTS[name]["optional-dependencies"].keys()


def test_an_extension_is_found_by_the_name_of_its_folder():
    folders = {path.parent.name for path in ROOT.glob("extensions/*/pyproject.toml")}
    assert {f"{CORE}-{folder}" for folder in folders} == PROJECTS.keys() - {CORE}
    needed = list_needed(["gslcosim-archive"])
    assert {"gslcosim", "gslcosim-archive", *list_needed(["gslcosim-bench"])} == set(needed)
