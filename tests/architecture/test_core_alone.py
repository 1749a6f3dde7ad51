"""The core runs without extensions, with the same digest, and answers for each that is missing."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml
from fresh_environments import (
    ROOT,
    FreshEnvironment,
    copy_checkout,
    create_environment,
    install_into,
    list_required,
)

from gslcosim.base.extensions import read_known

EXTENSIONS = sorted(path.parent.name for path in ROOT.glob("extensions/*/pyproject.toml"))
SCENARIO = "tiny_room"
# Blocks that the core reads and that only a reader, solver or model of an extension can serve.
READ_BY_CORE = {
    "gas.model=playback": {
        "gas": {"model": "playback", "sources": [{"position_m": [1.5, 2, 1]}], "playback": {"folder": "."}}
    },
    "wind.solver.file": {"wind": {"solver": {"file": "wind.csv"}}},
    "wind.solver.openfoam": {"wind": {"solver": "openfoam", "end_time_s": 5}},
}


def list_dependents(extension: str) -> set[str]:
    """An extension, and all that cannot be installed without it."""
    found = {extension}
    while True:
        more = {name for name in EXTENSIONS if _list_needed(name) & found} - found
        if not more:
            return found
        found |= more


def _list_needed(extension: str) -> set[str]:
    project = tomllib.loads((ROOT / "extensions" / extension / "pyproject.toml").read_text())["project"]
    needs = (text.partition("==")[0] for text in project["dependencies"])
    return {name.removeprefix("gslcosim-") for name in needs if name.startswith("gslcosim-")}


@pytest.fixture(scope="session")
def core(tmp_path_factory) -> list[Path]:
    """What is installed of the core from a checkout without extensions."""
    checkout, installed = tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("core")
    copy_checkout(checkout, without=["extensions", "tests", "docs"])
    install_into(installed, checkout)
    return [path for path in installed.iterdir() if path.name != "bin"]


@pytest.fixture(scope="session")
def installed(tmp_path_factory) -> dict[str, list[Path]]:
    """What is installed of each extension."""
    checkouts, folder = tmp_path_factory.mktemp("checkouts"), tmp_path_factory.mktemp("extensions")
    for name in EXTENSIONS:
        shutil.copytree(ROOT / "extensions" / name, checkouts / name, ignore=_ignore_built)
    install_into(folder, *(checkouts / name for name in EXTENSIONS))
    return {name: list(folder.glob(f"gslcosim_{name}*")) for name in EXTENSIONS}


def _ignore_built(folder: str, names: list[str]) -> list[str]:
    del folder
    return [name for name in names if name in ("tests", "build", "__pycache__") or name.endswith(".egg-info")]


@pytest.fixture(scope="session")
def alone(core, tmp_path_factory) -> FreshEnvironment:
    """An environment with the core, and what it declares to need."""
    return create_environment(tmp_path_factory.mktemp("alone") / "venv", core, list_required(ROOT))


@pytest.fixture(scope="session")
def whole_tree_digest(tmp_path_factory) -> str:
    """The digest of a run by the whole tree: one for all tests, as it depends neither on processes nor on languages."""
    command = [sys.executable, "-P", "-m", "gslcosim", "up", SCENARIO, "--in-process", "--json"]
    folder = tmp_path_factory.mktemp("whole_tree")
    return read_digest(subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, timeout=500))


def read_digest(outcome: subprocess.CompletedProcess[str]) -> str:
    result = json.loads(outcome.stdout or "{}")
    assert outcome.returncode == 0, (result.get("faults"), outcome.stderr)
    return result["digest"]


def assert_answered(text: str, extension: str) -> None:
    remedy = f"It is in the extension {extension}, which is not installed: pip install gslcosim-{extension}"
    assert remedy in " ".join(text.split()), text
    assert "Traceback" not in text


@pytest.mark.slow
@pytest.mark.tour
def test_the_core_alone_runs_with_the_digest_of_the_whole_tree(alone, whole_tree_digest, tmp_path):
    absent = alone.evaluate("import gslcosim_bench", cwd=tmp_path)
    assert "ModuleNotFoundError" in absent.stderr
    for words in (["--help"], ["list"], ["validate", SCENARIO]):
        outcome = alone.call(*words, cwd=tmp_path)
        assert outcome.returncode == 0, outcome.stderr
    assert read_digest(alone.call("up", SCENARIO, "--in-process", "--json", cwd=tmp_path)) == whole_tree_digest


@pytest.mark.slow
@pytest.mark.tour
def test_the_core_alone_answers_for_each_extension(alone, tmp_path):
    for extension in read_known():
        for text in list_answers(alone, extension, tmp_path):
            assert_answered(text, extension)


@pytest.mark.slow
@pytest.mark.end_to_end
def test_the_core_alone_runs_in_many_processes(alone, whole_tree_digest, tmp_path):
    assert read_digest(alone.call("up", SCENARIO, "--json", cwd=tmp_path)) == whole_tree_digest


@pytest.mark.slow
@pytest.mark.end_to_end
@pytest.mark.debian
@pytest.mark.skipif(
    shutil.which("cc") is None
    or shutil.which("pkg-config") is None
    or subprocess.run(["pkg-config", "--exists", "jansson"], check=False).returncode != 0,
    reason="no compiler of C, or no jansson",
)
def test_the_core_alone_runs_an_agent_in_c(alone, whole_tree_digest, tmp_path):
    build = tmp_path / "build"
    subprocess.run(["make", "--silent", f"BUILD={build}"], cwd=ROOT / "agents" / "dung_beetle_c", check=True)
    start = f"agents[0].start={{command: [{build}/agent], door: stdio, format: json}}"
    assert read_digest(alone.call("up", SCENARIO, "--json", "--set", start, cwd=tmp_path)) == whole_tree_digest


@pytest.mark.slow
@pytest.mark.end_to_end
@pytest.mark.parametrize("missing", EXTENSIONS)
def test_all_but_one_extension_run_and_answer_for_it(core, installed, whole_tree_digest, tmp_path, missing):
    left = [name for name in EXTENSIONS if name not in list_dependents(missing)]
    projects = [ROOT, *(ROOT / "extensions" / name for name in left)]
    packages = [*core, *(path for name in left for path in installed[name])]
    environment = create_environment(tmp_path / "venv", packages, list_required(*projects))
    for text in list_answers(environment, missing, tmp_path, left):
        assert_answered(text, missing)
    helped = environment.call("--help", cwd=tmp_path)
    assert helped.returncode == 0, helped.stderr
    assert read_digest(environment.call("up", SCENARIO, "--in-process", "--json", cwd=tmp_path)) == whole_tree_digest


def list_answers(environment: FreshEnvironment, extension: str, folder: Path, present: Sequence[str] = ()) -> list[str]:
    """What each command, key, kind of file and public name of an extension is answered with.

    A command of another extension that is not `present` either is answered with that one, whatever follows it.
    """
    offers = read_known()[extension]
    others = [name for name in read_known() if name not in (extension, *present)]
    of_others = {word for name in others for word in read_known()[name].get("commands", ())}
    files = {kind: folder / f"{kind}_of_{extension}.yaml" for kind in offers.get("files", ())}
    for kind, file in files.items():
        file.write_text(f"schema: gslcosim/{kind}/1\n")
    asked = [
        *(word.split() for word in offers.get("commands", ()) if "--" not in word and word.split()[0] not in of_others),
        *(["validate", str(file)] for file in files.values()),
        *(["validate", str(write_scenario(folder, key))] for key in offers.get("keys", ())),
    ]
    names = [name for name in offers.get("names", ()) if name != extension]
    return environment.list_errors(asked, [f"gslcosim.{name}" for name in names[:1]], cwd=folder)


def write_scenario(folder: Path, key: str) -> Path:
    """A scenario with a key of an extension, in JSON."""
    values = yaml.safe_load((ROOT / "scenarios" / f"{SCENARIO}.yaml").read_text())
    file = folder / f"{re.sub(r'[^a-z0-9]', '_', key)}.yaml"
    if key in READ_BY_CORE:
        file.write_text(json.dumps(values | READ_BY_CORE[key]))
        return file
    values.setdefault("participants", [{"name": "fan", "reads": [{"port": "truth/bodies"}], "writes": ["x"]}])
    block = values
    *path, last = key.split(".")
    for part in path:
        inner = block.setdefault(part.removesuffix("[]"), {})
        block = inner[0] if part.endswith("[]") else inner
    name, _, value = last.partition("=")
    block[name] = value or {}
    file.write_text(json.dumps(values))
    return file


@pytest.mark.slow
def test_an_agent_that_needs_an_extension_names_it(alone, tmp_path):
    outcome = alone.call("up", SCENARIO, "--in-process", "--set", "agents[0].start.python=infotaxis", cwd=tmp_path)
    assert outcome.returncode == 2
    assert_answered(outcome.stderr, "search")
