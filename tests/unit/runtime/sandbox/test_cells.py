"""What an agent may not see: runs, results of suites, rooms, and files that hold the truth under any name."""

from gslcosim.runtime.sandbox.cells import lies_in_truth, truth_within

RUN = ("scenario.yaml", "manifest.json", "inputs.log", "logs/agent_x.log")
RESULTS = ("suite.yaml", "manifest.json", "trials.parquet", "tables/all.csv", "agents/mine/mine.py")
ROOM = ("environment.yaml", "occupancy.npy")


def made(folder, names):
    """Make a folder with empty files."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder


def test_folders_of_truth_are_found_whole_however_they_are_named(tmp_path):
    run, results, room = (
        made(tmp_path / name, names) for name, names in (("a", RUN), ("b", RESULTS), ("deep/er/c", ROOM))
    )
    made(tmp_path / "mine", ("agent.py", "notes.yaml"))
    assert sorted(truth_within([tmp_path])) == sorted([run, results, room])


def test_single_files_of_truth_are_found_by_what_they_hold(tmp_path):
    texts = {
        "a.yaml": "schema: gslcosim/scenario/1",
        "b.json": '{"schema": "gslcosim/results/1"}',
        "c.json": '{"schema": "gslcosim/maps/1"}',
        "d.yml": "format: gslcosim/environment/1",
        "mine.yaml": "gain: 3",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    assert {path.name for path in truth_within([tmp_path])} == {"a.yaml", "b.json", "c.json", "d.yml"}


def test_what_lies_in_a_folder_of_truth_is_truth_but_for_the_programs_that_results_keep(tmp_path):
    run, results = made(tmp_path / "a", RUN), made(tmp_path / "b", RESULTS)
    assert lies_in_truth(run)
    assert lies_in_truth(run / "logs")
    assert lies_in_truth(results / "tables")
    assert not lies_in_truth(results / "agents" / "mine")
    assert not lies_in_truth(tmp_path)
    (tmp_path / "link").symlink_to(run)
    assert lies_in_truth(tmp_path / "link")
