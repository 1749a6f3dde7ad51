"""The wheel holds all that a run needs, under unambiguous names."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
IMPORT_NAMES = {
    "gslcosim": "gslcosim",
    "services": "gslcosim_services",
    "agents": "gslcosim_agents",
    "scenarios": "gslcosim_scenarios",
}
NOT_SHIPPED = {".pyc", ".rrd"}


@pytest.fixture(scope="module")
def names_in_wheel(tmp_path_factory) -> set[str]:
    """The files of a wheel that is built from a copy, so that nothing is left behind in the checkout."""
    copy = tmp_path_factory.mktemp("source")
    for folder in IMPORT_NAMES:
        shutil.copytree(
            ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__", "target", "node_modules")
        )
    for file in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, copy / file)
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(copy / "dist"), str(copy)]
    outcome = subprocess.run(command, capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    (wheel,) = (copy / "dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def shipped(folder: str) -> set[str]:
    """The names that the files of a source folder must have in the wheel."""
    files = (path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {
        f"{IMPORT_NAMES[folder]}/{path.relative_to(ROOT / folder).as_posix()}"
        for path in files
        if path.suffix not in NOT_SHIPPED
    }


@pytest.mark.slow
@pytest.mark.parametrize("folder", IMPORT_NAMES)
def test_every_file_of_a_folder_is_in_the_wheel(names_in_wheel, folder):
    assert shipped(folder) - names_in_wheel == set()


@pytest.mark.slow
def test_the_wheel_brings_no_other_top_level_names(names_in_wheel):
    top = {name.split("/")[0] for name in names_in_wheel}
    assert {name for name in top if not name.endswith(".dist-info")} == set(IMPORT_NAMES.values())


@pytest.mark.slow
def test_the_wheel_has_the_command_and_the_licence(names_in_wheel):
    assert any(name.endswith(".dist-info/entry_points.txt") for name in names_in_wheel)
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names_in_wheel)
