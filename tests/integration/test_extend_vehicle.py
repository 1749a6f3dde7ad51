"""The page on new vehicles: its steps on a copy of the package, and its example as an installed wheel."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim.vehicles.catalogue import _SECTIONS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extend" / "vehicle.md").read_text()
EXAMPLE = ROOT / "docs" / "examples" / "vehicle_package"
BLOCKS = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)

pytestmark = [pytest.mark.slow]


def run(command, **options):
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


@pytest.fixture(scope="module")
def shell(tmp_path_factory):
    """Run lines of the page in a copy of the package."""
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(ROOT / "gslcosim", folder / "gslcosim", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "PYTHONPATH": str(folder)}

    def lines(text):
        command = text.replace("gslcosim list", f"{sys.executable} -m gslcosim list")
        command = command.replace("gslcosim up", f"{sys.executable} -m gslcosim up")
        command = command.replace("gslcosim validate", f"{sys.executable} -m gslcosim validate")
        return run(["sh", "-ec", command], cwd=folder, env=environment)

    return lines


def test_the_steps_of_the_page_add_a_vehicle(shell):
    copy, change, fly = BLOCKS
    assert shell(copy).returncode == 0
    listed = shell(change)
    assert re.search(r"courier +multirotor +1.835 +0.76 +An iris that carries 0.3 kg\.", listed.stdout), listed.stderr
    validate, up = fly.splitlines()
    shown = shell(validate)
    assert shown.returncode == 0, shown.stderr
    flown = shell(f"{up} --json")
    assert flown.returncode in (0, 1), flown.stderr
    assert json.loads(flown.stdout)["valid"]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder in which the example is installed from its wheel."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(EXAMPLE, folder / "source")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    built = run([*build, str(folder / "source")])
    assert built.returncode == 0, built.stdout + built.stderr
    (wheel,) = folder.glob("*.whl")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    installed = run([*pip, "--target", str(folder / "site"), str(wheel)])
    assert installed.returncode == 0, installed.stderr
    return folder / "site"


def test_the_vehicle_of_an_installed_package_runs(site, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(site)}
    listed = run([sys.executable, "-m", "gslcosim", "list", "vehicles", "--json"], env=environment)
    assert "blimp" in [row["name"] for row in json.loads(listed.stdout)["vehicles"]]
    up = [sys.executable, "-m", "gslcosim", "up", "tiny_room", "--in-process", "--json", "--runs-dir", str(tmp_path)]
    flown = run([*up, "--set", "agents[0].vehicle.model=blimp"], env=environment)
    assert flown.returncode in (0, 1), flown.stderr
    assert json.loads(flown.stdout)["valid"]


def test_the_entry_point_of_the_page_is_that_of_the_example():
    (piece,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert piece in (EXAMPLE / "pyproject.toml").read_text()


def test_the_page_names_every_section():
    sections = {section for kind in _SECTIONS.values() for section in kind} | {"description", "kind"}
    assert [name for name in sections if f"| `{name}` |" not in PAGE] == []
