"""The pages on environment folders and exchange do what they say."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from gslcosim.cli.main import main
from gslcosim.environment.store import HEADER_FILE, OCCUPANCY_FILE, WIND_FILE, load_environment
from gslcosim_formats.export import FORMATS, GADEN_WINDS

DOCS = Path(__file__).parents[2] / "docs"
FOLDER_PAGE, EXCHANGE_PAGE = DOCS / "environment-folder.md", DOCS / "exchange.md"


def block(page, language):
    return re.search(rf"```{language}\n(.*?)```", page.read_text(), re.DOTALL)[1]


@pytest.fixture
def hall(tmp_path):
    """The folder that the page describes, written without this project's code."""
    folder = tmp_path / "hall"
    folder.mkdir()
    (folder / HEADER_FILE).write_text(block(FOLDER_PAGE, "yaml"))
    np.save(folder / OCCUPANCY_FILE, np.zeros((4, 3, 2), np.uint8))
    np.save(folder / WIND_FILE, np.full((1, 4, 3, 2, 3), 0.5, np.float32))
    return folder


def test_a_folder_as_described_is_read(hall):
    environment = load_environment(hall)
    assert (environment.name, environment.grid.shape) == ("shed", (4, 3, 2))
    assert [each.name for each in (*environment.boxes, *environment.openings)] == ["wall_x_max", "outlet"]


def test_every_key_of_a_folder_is_described(hall, tmp_path):
    main(["environment", "export", str(hall), "--to", "gaden", "--out", str(tmp_path / "gaden")])
    main(["environment", "import", str(tmp_path / "gaden"), "--out", str(tmp_path / "again")])
    keys = re.findall(r"^(\w+):", (tmp_path / "again" / HEADER_FILE).read_text(), re.MULTILINE)
    assert keys == re.findall(r"^(\w+):", block(FOLDER_PAGE, "yaml"), re.MULTILINE)
    assert keys == re.findall(r"^\| `(\w+)` \|", FOLDER_PAGE.read_text(), re.MULTILINE)


def test_the_program_reads_it(hall, monkeypatch, capsys):
    monkeypatch.chdir(hall.parent)
    exec(compile(block(FOLDER_PAGE, "python"), str(FOLDER_PAGE), "exec"), {})
    assert capsys.readouterr().out == "0 [0.5 0.5 0.5]\n"


@pytest.mark.slow
def test_the_calls_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    calls = block(EXCHANGE_PAGE, "").splitlines()
    assert len(calls) == 4
    for call in calls:
        assert main(shlex.split(call)[1:]) == 0
    one, other = load_environment(tmp_path / "hall"), load_environment(tmp_path / "hall_again")
    np.testing.assert_array_equal(one.occupancy, other.occupancy)
    np.testing.assert_array_equal(one.wind.velocity_m_s, other.wind.velocity_m_s)
    shutil.rmtree(tmp_path / "hall")


def test_every_format_that_is_written_is_described():
    text = EXCHANGE_PAGE.read_text()
    assert [name for name in FORMATS if f"| `{name}` |" not in text] == []
    assert [name for name in GADEN_WINDS if f"`{name}`" not in text] == []
