"""Kernels that were compiled before: an agent in a sandbox sees those of all installed packages and of its own code."""

import os
from pathlib import Path

import pytest
from numba.core.caching import UserProvidedCacheLocator

import gslcosim
from gslcosim.base.extension_packages import find_extension_packages
from gslcosim.base.kernel_cache import get_kernels_folder_name
from gslcosim.runtime.processes.sandbox.launcher_client import (
    Confinement,
    Launch,
    is_launcher_possible,
    name_numba_folder,
)
from gslcosim.runtime.processes.sandbox.policy import SandboxPolicy


def test_folders_have_the_names_that_numba_gives_them():
    module = Path(gslcosim.__file__).parent / "environment" / "sight_kernels.py"
    assert name_numba_folder(module.parent) == UserProvidedCacheLocator.get_suitable_cache_subpath(str(module))


def get_name_in_cache(folder):
    return get_kernels_folder_name(folder, name_numba_folder(folder))


@pytest.mark.skipif(not is_launcher_possible(), reason="agents are confined on Linux only")
def test_a_cache_of_many_installations_is_not_linked_whole(tmp_path):
    """A start made, and an end removed, links to seven thousand files where many versions had been tried."""
    ours = Path(gslcosim.__file__).parent / "environment"
    of_the_agent = tmp_path / "mine"
    installed = (ours, of_the_agent, *find_extension_packages().values())
    kernels, scratch = tmp_path / "kernels", tmp_path / "scratch"
    for folder in (*installed, Path("/elsewhere/gslcosim/environment")):
        (kernels / get_name_in_cache(folder)).mkdir(parents=True)
        (kernels / get_name_in_cache(folder) / "kernel.nbc").touch()
    scratch.mkdir()
    cell = SandboxPolicy(directory=of_the_agent, kernels=kernels, scratch=scratch, reads=(), hidden=(), writes=())
    confinement = Confinement(kind="landlock", policy=cell)
    launch = Launch(confinement, ["python"], environment={}, directory=of_the_agent, has_pipes=False)
    for descriptor in launch.descriptors:
        os.close(descriptor)
    linked = {path.parent.name: path.readlink() for path in (scratch / "kernels").rglob("*.nbc")}
    assert linked == {name: kernels / name / "kernel.nbc" for name in map(get_name_in_cache, installed)}
