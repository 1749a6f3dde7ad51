"""Modules can be imported where Linux's own modules of Python are away: what needs them says so when it is used."""

import subprocess
import sys

import pytest

# All is imported once as it is, so that other packages are loaded; then ours once more, on a system that has less.
SCRIPT = """
import importlib, pkgutil, sys
from gslcosim.base.extension_packages import find_extension_packages

OURS = ("gslcosim", "gslcosim_services", *find_extension_packages())
ALONE = {"gslcosim.runtime.processes.sandbox.launcher"}  # a program of its own, which only Linux runs
for name in OURS:
    importlib.import_module(name)
found = (pkgutil.walk_packages(sys.modules[name].__path__, f"{name}.") for name in OURS)
names = [each.name for package in found for each in package]
names = [name for name in names if not name.endswith("__main__") and ".templates" not in name and name not in ALONE]
for name in names:
    importlib.import_module(name)
for name in [name for name in sys.modules if name.split(".")[0] in OURS]:
    del sys.modules[name]
LINUX = {"fcntl", "resource", "termios", "tty", "pty", "pwd", "grp"}

class Away:
    def find_spec(self, name, path=None, target=None):
        if name in LINUX:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

for name in LINUX:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Away())
sys.platform = "win32"
failed = {}
for name in names:
    try:
        importlib.import_module(name)
    except Exception as error:
        failed[name] = repr(error)
print(len(names), failed)
"""


@pytest.mark.slow
@pytest.mark.extras
def test_every_module_can_be_imported_without_them():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    n_modules, failed = done.stdout.strip().splitlines()[-1].split(maxsplit=1)
    assert int(n_modules) > 300
    assert failed == "{}"
