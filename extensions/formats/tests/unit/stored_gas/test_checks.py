"""What keeps stored gas from being a scenario's gas is known before the run, with the line that says otherwise."""

import gaden_writers as gaden
import numpy as np
import pytest

from gslcosim.cli.main import main

ROOM = """\
schema: gslcosim/scenario/1
name: hall
environment: {layout: {kind: warehouse_empty, size_m: [10, 8, 3]}}
wind: {solver: uniform, cell_m: 0.25}
gas:
  model: playback
  gas: GAS
  sources:
    - {position_m: [8, 1, 1]}
    - {position_m: SOURCE}
  playback: {folder: FOLDER}
agents:
  - name: beetle
    start: {python: dung_beetle}
    vehicle: {start_m: [5, 5, 0.2], search_height_m: 1}
    sensors: [{model: tgs2600, name: nose}, {model: anemometer, name: wind}]
"""


@pytest.fixture
def call_with_gas(tmp_path, capsys):
    """Return exit code and lines of a command for a scenario that plays stored gas beside it."""
    (tmp_path / "frames").mkdir()
    for i in (0, 2):
        (tmp_path / "frames" / f"iteration_{i}").write_bytes(gaden.compressed(gaden.version_3()))
    np.savez(tmp_path / "faulty.npz", time_s=[0.0])
    (tmp_path / "empty").mkdir()

    def tell(command, *, gas="methane", source="[0.5, 3, 1]", folder="frames"):
        path = tmp_path / "hall.yaml"
        path.write_text(ROOM.replace("GAS", gas).replace("SOURCE", source).replace("FOLDER", folder))
        code = main([command, str(path)])
        return code, capsys.readouterr().err.replace(f"{tmp_path}/", "").splitlines()

    return tell


def test_stored_gas_of_the_scenario_s_source_is_valid(call_with_gas):
    code, (warning,) = call_with_gas("validate")
    assert code == 0
    assert warning.startswith("Warning: gas.playback.folder: expected the wind in which this gas was simulated")


@pytest.mark.parametrize("command", ["validate", "up"])
def test_gas_of_another_source_and_name_is_reported_with_its_lines(call_with_gas, command):
    code, lines = call_with_gas(command, gas="ethanol", source="[5, 5, 2]")
    assert code == 2
    assert lines[1:] == [
        "hall.yaml:7: gas.gas: expected methane, the gas of the stored frames, was ethanol. Write gas: methane.",
        "hall.yaml:10: gas.sources[1].position_m: expected the place of the source in the stored frames, within 1 m, "
        "was [5, 5, 2], which is 5.02 m from it. Write position_m: [0.5, 3, 1].",
    ]


@pytest.mark.parametrize(
    ("folder", "words"), [("empty", "expected files iteration_0"), ("faulty.npz", "gas movie: expected")]
)
def test_gas_that_cannot_be_read_is_reported_with_its_line(call_with_gas, folder, words):
    code, (line,) = call_with_gas("validate", folder=folder)
    assert code == 2
    assert line.startswith("hall.yaml:11: gas.playback.folder: expected frames of gas, or a movie, that can be read")
    assert words in line
