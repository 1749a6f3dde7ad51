"""OpenFOAM is found where packagers put it; where there is none the message says how to get it.

The tools are stand-ins: shell scripts of the same name.
"""

import pytest

from gslcosim.base.errors import FlowError
from gslcosim_formats.openfoam import find_installation


def make_tool(folder, name="pimpleFoam"):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("#!/bin/sh\n")
    (folder / name).chmod(0o755)


def make_project(folder):
    """Make a project folder as from openfoam.com: tools found by sourcing etc/bashrc, which reads its arguments."""
    make_tool(folder / "bin")
    (folder / "etc").mkdir()
    (folder / "etc" / "bashrc").write_text(
        f'echo "settings: $@" >&2\nexport WM_PROJECT_DIR={folder} PATH={folder}/bin:$PATH WM_OPTIONS="$*"\n'
    )
    return folder


@pytest.fixture(autouse=True)
def without_openfoam(monkeypatch, tmp_path):
    monkeypatch.delenv("WM_PROJECT_DIR", raising=False)
    (tmp_path / "system").mkdir()
    for name in ("bash", "env"):
        (tmp_path / "system" / name).symlink_to(f"/usr/bin/{name}")
    monkeypatch.setenv("PATH", str(tmp_path / "system"))


def test_tools_on_the_path_are_taken(monkeypatch, tmp_path):
    make_tool(tmp_path / "bin")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    installation = find_installation(project_dirs=())
    assert installation.tool("pimpleFoam") == str(tmp_path / "bin" / "pimpleFoam")
    assert installation.environment["WM_PROJECT_DIR"] == "/usr/share/openfoam"


def test_the_newest_of_several_folders_is_taken(tmp_path):
    for version in ("openfoam906", "openfoam2212", "openfoam2112"):
        make_project(tmp_path / "opt" / version)
    installation = find_installation(project_dirs=(f"{tmp_path}/opt/openfoam*",))
    assert installation.project_dir.name == "openfoam2212"
    assert installation.tool("pimpleFoam") == str(tmp_path / "opt/openfoam2212/bin/pimpleFoam")
    assert installation.environment["WM_OPTIONS"] == ""


def test_the_folder_that_the_variable_names_comes_first(monkeypatch, tmp_path):
    make_project(tmp_path / "opt" / "openfoam2212")
    mine = make_project(tmp_path / "mine")
    monkeypatch.setenv("WM_PROJECT_DIR", str(mine))
    assert find_installation(project_dirs=(f"{tmp_path}/opt/openfoam*",)).project_dir == mine


def test_without_any_the_message_says_where_it_was_looked_for_and_how_to_get_it(tmp_path):
    with pytest.raises(FlowError, match=r"\$WM_PROJECT_DIR or .*/opt/openfoam\*, found none.*apt-get install"):
        find_installation(project_dirs=(f"{tmp_path}/opt/openfoam*",))


def test_a_tool_that_is_missing_is_named(tmp_path):
    project = make_project(tmp_path / "opt" / "openfoam2212")
    installation = find_installation(project_dirs=(str(project),))
    with pytest.raises(FlowError, match="expected its tool decomposePar"):
        installation.tool("decomposePar")
