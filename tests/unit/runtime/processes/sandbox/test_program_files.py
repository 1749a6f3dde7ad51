"""Files of a program that a sandbox binds: its code, and those that its card names."""

import os

import pytest
import yaml

from gslcosim.base.errors import UsageError
from gslcosim.base.yaml_core import CoreLoader
from gslcosim.methods.card import SHARED_PARAMETERS
from gslcosim.runtime.processes.sandbox import program_files
from gslcosim.runtime.processes.sandbox.program_files import (
    PrivatePlaces,
    is_truth_folder,
    list_run_places,
    select_program_files,
)

RUN = ("scenario.yaml", "manifest.json", "inputs.log", "logs/agent_x.log", "agents/other.py")
RESULTS = ("suite.yaml", "manifest.json", "trials.parquet", "tables/all.csv", "agents/mine/mine.py")
ROOM = ("environment.yaml", "occupancy.npy")
CARD = yaml.load((SHARED_PARAMETERS.parents[2] / "agents/dung_beetle/method.yaml").read_text(), Loader=CoreLoader)


def made(folder, *names):
    """Make a folder with empty files."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder


def bound(folder, *, private=(), named=("agent.py",)):
    """Return the names of all that is bound of a folder."""
    files = [folder / name for name in named]
    selected = select_program_files(folder, files, PrivatePlaces(private), place="agents.a")
    return sorted({path.relative_to(folder).as_posix() for path in selected.reads})


def test_code_alone_is_bound_and_what_is_not_is_named(tmp_path):
    """Copies of the truth under other names have no kind of code."""
    made(
        tmp_path, "agent.py", "tools.py", "package/inner/part.py", "package/data.json", "package.json", ".cargo/key.py"
    )
    made(tmp_path, "renamed.yaml", "room", "room.txt", "run.zip", "room.npz", "a/b/copy.json", "x.ipynb", ".git/a.py")
    selected = select_program_files(tmp_path, [tmp_path / "agent.py"], PrivatePlaces([]), place="agents[0]")
    assert bound(tmp_path) == ["agent.py", "package.json", "package/inner", "tools.py"]
    unseen = {path.relative_to(tmp_path).as_posix() for path in selected.unseen}
    assert unseen >= {"renamed.yaml", "room.txt", "run.zip", "room.npz", "a/b/copy.json", "package/data.json"}


@pytest.mark.parametrize(
    "signs", [("scenario.yaml",), [f"old/{name}" for name in RUN], [f"old/{name}" for name in RESULTS],
              [f"hall/{name}" for name in (*ROOM, "room.py")]]
)  # fmt: skip
def test_folders_of_runs_results_and_rooms_are_not_entered(tmp_path, signs):
    assert bound(made(tmp_path, "agent.py", *signs)) == ["agent.py"]


def test_the_folder_of_a_program_is_never_bound_whole(tmp_path):
    """Runs, and whatever else, may be made in it while the agent looks."""
    assert bound(made(tmp_path, "agent.py", "src/a.py", "src/deep/b.py")) == ["agent.py", "src"]


def test_of_a_bundle_all_files_are_the_programs(tmp_path):
    made(tmp_path, "agent.py", "submission.yaml", "parts/data.json", ".env", "scenario.yaml", "room.obj")
    assert bound(tmp_path, private=[tmp_path / "room.obj"]) == ["agent.py", "parts", "submission.yaml"]


def test_a_program_without_a_suffix_is_code_by_its_first_bytes(tmp_path):
    made(tmp_path, "agent.py", "notes")
    for name, data in {"helper": b"\x7fELF", "start": b"#!/bin/sh", "room": b"schema: gslcosim/scenario/1"}.items():
        (tmp_path / name).write_bytes(data)
        (tmp_path / name).chmod(0o755)
    assert bound(tmp_path) == ["agent.py", "helper", "start"]


def test_links_to_what_belongs_to_a_run_are_not_bound(tmp_path):
    source = made(tmp_path, "elsewhere/room.obj") / "elsewhere" / "room.obj"
    mine = made(tmp_path / "mine", "agent.py", "tools.py")
    os.link(source, mine / "hard.py")
    (mine / "symbolic.py").symlink_to(source)
    (mine / "package").symlink_to(source.parent)
    assert bound(mine, private=[source]) == ["agent.py", "tools.py"]


def test_a_named_file_that_belongs_to_a_run_is_not_bound(tmp_path):
    made(tmp_path, "agent.py", "room.yaml", "linked")
    assert bound(tmp_path, private=[tmp_path / "room.yaml"], named=("agent.py", "room.yaml")) == ["agent.py"]


def with_card(folder, *files):
    (folder / "method.yaml").write_text(yaml.safe_dump({**CARD, "files": list(files)}))
    return folder


def test_a_card_names_files_beside_the_code(tmp_path):
    with_card(made(tmp_path, "agent.py", "scenario.yaml", "table.csv", "tools.py", "net/a.npz"), "table.csv", "net")
    assert bound(tmp_path) == ["agent.py", "method.yaml", "net", "table.csv", "tools.py"]
    selected = select_program_files(tmp_path, [], PrivatePlaces([]), place="agents[0]")
    assert selected.unseen == (), "files of a run are no data of the program"
    assert bound(with_card(tmp_path)) == ["agent.py", "method.yaml", "tools.py"]


@pytest.mark.parametrize("name", ["..", "/", ".", "../other", "sub/../..", "/etc", "link", "missing", "linked/.."])
def test_a_card_names_nothing_outside_of_its_folder(tmp_path, name):
    mine = with_card(made(tmp_path / "mine", "agent.py"), name)
    made(tmp_path, "other")
    (mine / "link").symlink_to(tmp_path)
    with pytest.raises(UsageError, match=r"method\.yaml: files: expected files and folders within the folder"):
        bound(mine)


@pytest.mark.parametrize("name", ["scenario.yaml", "old", "above"])
def test_a_card_names_nothing_of_a_run(tmp_path, name):
    made(tmp_path, "agent.py", "scenario.yaml", "above/deep/linked.py", *(f"old/{each}" for each in RUN))
    source = tmp_path / "above" / "deep" / "linked.py"
    with pytest.raises(UsageError, match=r"files: expected files of the program, found .*, which belongs to a run"):
        bound(with_card(tmp_path, name), private=[source])


def test_a_folder_with_too_much_is_refused(tmp_path, monkeypatch):
    made(tmp_path, *(f"{i}.py" for i in range(4)), "agent.py", "scenario.yaml")
    monkeypatch.setattr(program_files, "MAX_PLACES", 3)
    with pytest.raises(UsageError, match=r"at most 3 files of code beside files that are none"):
        bound(tmp_path)
    monkeypatch.setattr(program_files, "MAX_ENTRIES", 3)
    with pytest.raises(UsageError, match="at most 3 files in a folder that an agent reads"):
        bound(tmp_path)


def test_packages_are_bound_whole_without_a_look_into_them(tmp_path):
    made(tmp_path, "agent.js", "scenario.yaml", "node_modules/x/logo.png")
    assert bound(tmp_path, named=("agent.js",)) == ["agent.js", "node_modules"]


def test_nothing_but_plain_files_is_opened(tmp_path):
    """A pipe would be waited for, for ever."""
    made(tmp_path, "agent.py")
    os.mkfifo(tmp_path / "pipe", 0o755)
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "loop.py").symlink_to("loop.py")
    assert bound(tmp_path) == ["agent.py"]


def test_a_link_to_code_of_the_folder_is_code(tmp_path):
    made(tmp_path, "agent.py", "notes.txt", "src/tools.py")
    (tmp_path / "tools.py").symlink_to("src/tools.py")
    (tmp_path / "notes.py").symlink_to("notes.txt")
    assert bound(tmp_path) == ["agent.py", "src", "tools.py"]


def test_of_a_granted_folder_what_belongs_to_runs_is_listed(tmp_path):
    made(tmp_path, "table.csv", "scenario.yaml", ".git/a", *(f"sub/old/{name}" for name in RUN))
    found = list_run_places(tmp_path, PrivatePlaces([tmp_path / "table.csv"]), place="agents[0]")
    assert {path.name for path in found} == {"table.csv", "scenario.yaml", ".git", "old"}


def test_what_lies_in_a_folder_of_truth_is_truth_but_for_the_programs_that_results_keep(tmp_path):
    run, results = made(tmp_path / "a", *RUN), made(tmp_path / "b", *RESULTS)
    assert is_truth_folder(run)
    assert is_truth_folder(run / "logs")
    assert is_truth_folder(results / "tables")
    assert not is_truth_folder(results / "agents" / "mine")
    assert not is_truth_folder(results / "suites" / "included" / "agents" / "mine")
    assert is_truth_folder(results / "suites" / "included" / "scenarios")
    assert is_truth_folder(results / "suites" / "agents")
    assert not is_truth_folder(tmp_path)
    (tmp_path / "link").symlink_to(run)
    assert is_truth_folder(tmp_path / "link")
