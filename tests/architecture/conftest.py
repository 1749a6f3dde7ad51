"""What tests of pages about extensions share."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def lay_out_package() -> Callable[[str, Path], Path]:
    """Write the files that a page gives, and put the package where Python finds it, as an installation does."""

    def lay_out(page: str, folder: Path) -> Path:
        for name, text in re.findall(r"^`(\S+)`:\n\n```\w+\n(.*?)```", page, re.MULTILINE | re.DOTALL):
            (folder / name).write_text(text)
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        name, version = project["name"], project["version"]
        info = folder / f"{name}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        groups = project["entry-points"].items()
        lines = [f"[{group}]\n" + "".join(f"{key} = {at}\n" for key, at in points.items()) for group, points in groups]
        (info / "entry_points.txt").write_text("".join(lines))
        return folder

    return lay_out


@pytest.fixture(scope="session")
def gslcosim_with() -> Callable[[Path, list[str], Path], subprocess.CompletedProcess[str]]:
    """Run the command line with a package beside it, in a folder."""

    def run(package: Path, words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
        call = [sys.executable, "-m", "gslcosim", *words]
        paths = os.pathsep.join([str(package), *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = os.environ | {"PYTHONPATH": paths}
        return subprocess.run(call, capture_output=True, text=True, cwd=folder, env=environment, check=False)

    return run


@pytest.fixture(scope="session")
def find_words() -> Callable[[str], list[str]]:
    """Return the words behind `gslcosim` in the one command that a page shows."""

    def find(page: str) -> list[str]:
        (command,) = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)
        program, *words = shlex.split(command)
        assert program == "gslcosim"
        return words

    return find
