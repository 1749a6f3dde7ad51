"""Versions of the Python packages that are installed, beside those of the lock file of a checkout."""

import hashlib
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

LOCK_FILE = Path(__file__).resolve().parents[2] / "requirements.lock"
_PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;]+)", re.MULTILINE)
_INSTALLED = re.compile(r"^([A-Za-z0-9._]+)-([^-]+)\.dist-info$")


def installed_versions() -> dict[str, str]:
    """Return the version of each installed package by its normalised name; the first on the path counts, as in imports.

    The names of folders say all of it: reading the files in them takes longer than a run's start should.
    """
    versions: dict[str, str] = {}
    for place in sys.path:
        try:
            names = [entry.name for entry in os.scandir(place or ".")]
        except OSError:
            continue
        for match in filter(None, map(_INSTALLED.match, names)):
            versions.setdefault(_normalised(match[1]), match[2])
    return versions


def versions_hash(versions: Mapping[str, str]) -> str:
    """Return the SHA-256 of names with versions, in the order of the names."""
    lines = "".join(f"{name}=={version}\n" for name, version in sorted(versions.items()))
    return hashlib.sha256(lines.encode()).hexdigest()


def compare_with_lock(versions: Mapping[str, str], file: Path = LOCK_FILE) -> dict[str, Any] | None:
    """Return the hash of a lock file and the installed packages whose version it does not name; None without the file.

    What is installed besides what the file names does not count.
    """
    try:
        content = file.read_bytes()
    except OSError:
        return None
    pins: dict[str, set[str]] = {}
    for name, version in _PIN.findall(content.decode(errors="replace")):
        pins.setdefault(_normalised(name), set()).add(version)
    differing = sorted(name for name, allowed in pins.items() if name in versions and versions[name] not in allowed)
    return {"sha256": hashlib.sha256(content).hexdigest(), "differing": differing}


def _normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
