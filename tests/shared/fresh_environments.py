"""Fresh Python environments with parts of this checkout installed, and nothing that these parts do not declare."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
CORE = "gslcosim"
# Commands, each a list of words, and then expressions in one process: a line of what each writes to standard error.
ANSWERS = """
import contextlib, io, json, sys
import gslcosim
from gslcosim.cli.main import main
commands, expressions = json.load(sys.stdin)
for words in commands:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as errors:
        with contextlib.suppress(SystemExit):
            main(words)
    print(json.dumps(errors.getvalue()))
for expression in expressions:
    try:
        print(json.dumps(repr(eval(expression))))
    except Exception as error:
        print(json.dumps(str(error)))
"""
SITE_PACKAGES = Path(sysconfig.get_path("platlib"))


@dataclass(frozen=True)
class FreshEnvironment:
    """An environment of its own in a folder."""

    folder: Path

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"

    @property
    def site_packages(self) -> Path:
        return next((self.folder / "lib").glob("python*")) / "site-packages"

    def call(self, *words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
        """Return the outcome of a command of gslcosim, whose folder is no checkout."""
        command = [str(self.python), "-P", "-m", CORE, *words]
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, timeout=500)

    def list_errors(self, commands: Sequence[Sequence[str]], expressions: Sequence[str], *, cwd: Path) -> list[str]:
        """Return what each of some commands, and then of some expressions, is answered with as an error."""
        command = [str(self.python), "-P", "-c", ANSWERS]
        asked = json.dumps([commands, expressions])
        outcome = subprocess.run(
            command, input=asked, capture_output=True, text=True, check=False, cwd=cwd, timeout=500
        )
        assert outcome.returncode == 0, outcome.stderr
        return [json.loads(line) for line in outcome.stdout.splitlines()]

    def evaluate(self, text: str, *, cwd: Path) -> subprocess.CompletedProcess[str]:
        """Return the outcome of Python code."""
        command = [str(self.python), "-P", "-c", text]
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, timeout=500)


def copy_checkout(folder: Path, *, without: Iterable[str]) -> None:
    """Copy the files of the checkout that belong to it, but for some folders."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, check=True).stdout.decode().split("\0")
    left_out = tuple(f"{name}/" for name in without)
    for name in filter(None, names):
        source, target = ROOT / name, folder / name
        if not name.startswith(left_out) and source.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_symlink():
                target.symlink_to(source.readlink())
            else:
                shutil.copy(source, target)


def install_into(folder: Path, *projects: Path) -> None:
    """Install projects without what they need, with the tools of this environment.

    Their modules are compiled once, for all environments that link them.
    """
    words = [
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--disable-pip-version-check",
    ]
    command = [sys.executable, "-m", "pip", "install", *words, "--target", str(folder), *map(str, projects)]
    outcome = subprocess.run(command, capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr


def create_environment(folder: Path, installed: Iterable[Path], packages: Iterable[str]) -> FreshEnvironment:
    """Return a new environment.

    Args:
        folder: Where it is made.
        installed: Packages of installed projects, and their metadata.
        packages: Names of distributions of this environment that it has as well.
    """
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    environment = FreshEnvironment(folder)
    places = [*installed, *(place for name in packages for place in _list_places(name))]
    for place in places:
        target = environment.site_packages / place.name
        # Sandboxes show the folder of an environment, and not what links in it lead to.
        if place.is_dir() and not target.exists():
            shutil.copytree(place, target, copy_function=_link_or_copy)
        elif not target.exists():
            _link_or_copy(place, target)
    return environment


def _link_or_copy(source: str | Path, target: str | Path) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def read_requirements(project: Path) -> list[Requirement]:
    """Return what a project declares to need here, without its extras."""
    declared = tomllib.loads((project / "pyproject.toml").read_text())["project"]["dependencies"]
    requirements = (Requirement(text) for text in declared)
    return [each for each in requirements if each.marker is None or each.marker.evaluate({"extra": ""})]


def list_required(*projects: Path) -> set[str]:
    """Return the names of all distributions that projects need, and that these need; not of this checkout."""
    found: set[str] = set()
    left = [each for project in projects for each in read_requirements(project)]
    while left:
        requirement = left.pop()
        name = canonicalize_name(requirement.name)
        if name.startswith(CORE):
            continue
        extras = requirement.extras or {""}
        if name in found and extras == {""}:
            continue
        found.add(name)
        for text in _read_needs(name):
            need = Requirement(text)
            is_needed = need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in extras)
            if is_needed and canonicalize_name(need.name) not in found:
                left.append(need)
    return found


@cache
def _read_needs(name: str) -> tuple[str, ...]:
    try:
        return tuple(distribution(name).requires or ())
    except PackageNotFoundError:
        return ()


@cache
def _list_places(name: str) -> tuple[Path, ...]:
    try:
        files = distribution(name).files or ()
    except PackageNotFoundError:
        return ()
    tops = {file.parts[0] for file in files} - {"..", "__pycache__"}
    return tuple(SITE_PACKAGES / top for top in sorted(tops) if (SITE_PACKAGES / top).exists())
