"""Packages that offer things under entry points, installed for a test alone."""

import importlib
import sys
import types
from pathlib import Path
from typing import Any

import pytest


def install_package(patch: pytest.MonkeyPatch, folder: Path, name: str, group: str, **offers: Any) -> None:
    """Install a package whose module has these things and offers each under its name, and one that is missing."""
    module = types.ModuleType(name)
    vars(module).update(offers)
    patch.setitem(sys.modules, name, module)
    points = "".join(f"{offer} = {name}:{offer}\n" for offer in offers)
    write_entry_points(patch, folder, name, f"[{group}]\n{points}broken = somebodys_missing_module:broken\n")


def write_entry_points(patch: pytest.MonkeyPatch, folder: Path, name: str, text: str) -> None:
    """Write what pip writes of a package with these entry points, and put its folder on the path."""
    facts = folder / f"{name}-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(text)
    patch.syspath_prepend(str(folder))
    importlib.invalidate_caches()
