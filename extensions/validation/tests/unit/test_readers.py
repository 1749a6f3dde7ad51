"""Readers of measured data: what is read, sets of other names, and one sentence for each bad input."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from laser_campaigns import write_lasers
from reference_data import MEASURED, needs_measured

from gslcosim_validation import MeasuredDataError, read_measured
from gslcosim_validation.readers.folder import FORMATS
from gslcosim_validation.readers.laser_paths import LaserPaths
from gslcosim_validation.readers.mast_network import MastNetwork
from gslcosim_validation.readers.room_sensors import RoomSensors


def write_network(folder, *, masts=("north", "south"), minutes=None, releases=None, site=None):
    """Write a small set of masts of our own."""
    folder.mkdir(parents=True)
    place = {"east_m": 0.0, "north_m": 0.0, "height_m": 2.0}
    content = {"masts": {"north": place, "south": place}, "candidate_places": {"tank": place, "well": place}}
    (folder / "site.json").write_text(json.dumps(site or content))
    header = ["time_utc", "wind_east_m_s", "wind_north_m_s", *(f"ch4_{mast}_ppm" for mast in masts)]
    rows = minutes or [["2030-01-01T00:00:00Z", "1", "0", "2.0", ""], ["2030-01-01T00:01:00Z", "1", "1", "2.1", "2"]]
    (folder / "minutes.csv").write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")
    text = releases or "7,2030-01-01T00:00:10Z,2030-01-01T00:00:50Z,well,1.8"
    (folder / "releases.csv").write_text(f"release,start_utc,end_utc,place,rate_kg_h\n{text}\n")
    return folder


def network_of(folder):
    data = read_measured(folder)
    return data.read(data.sets[0], MastNetwork)


def test_masts_of_any_name_are_read_with_units_and_gaps(tmp_path):
    network = network_of(write_network(tmp_path / "yard"))
    assert network.masts == ("north", "south")
    assert np.isnan(network.readings_ppm[0, 1])
    assert np.diff(network.clock_s).tolist() == [60.0]
    assert (network.releases[0].number, network.releases[0].place) == (7, "well")
    assert network.releases[0].rate_kg_s == pytest.approx(0.0005)
    assert network.pressure_pa == 101_325.0


def test_a_set_is_recognised_by_its_files_in_a_folder_of_any_name(tmp_path):
    write_network(tmp_path / "campaign" / "week 9")
    data = read_measured(tmp_path / "campaign")
    assert [(each.name, each.format) for each in data.sets] == [("week 9", "mast_network")]


def bad_minutes(tmp_path, *rows, **kwargs):
    return write_network(tmp_path / "yard", minutes=[list(row) for row in rows], **kwargs)


FIRST = ("2030-01-01T00:00:00Z", "1", "0", "2.0", "2")


@pytest.mark.parametrize(
    ("second", "said"),
    [
        (
            ("2030-01-01T00:00:00Z", "1", "0", "2", "2"),
            "yard/minutes.csv, line 3, column time_utc: expected a later time than in the row before, was "
            "2030-01-01T00:00:00Z after 2030-01-01T00:00:00Z. Sort the rows by time.",
        ),
        (
            ("2030-01-01T09:00:00Z", "1", "0", "2", "2"),
            "yard/minutes.csv, line 3, column time_utc: expected steps of at most 3600 s, was one of 32400 s. "
            "Fill the gap with rows whose readings are empty, or split the file there.",
        ),
        (
            ("01.01.2030 00:01", "1", "0", "2", "2"),
            "yard/minutes.csv, line 3, column time_utc: expected a time as 2022-05-09T02:18:02Z, was "
            "'01.01.2030 00:01'. Write times as ISO 8601.",
        ),
        (
            ("2030-01-01T00:01:00Z", "1", "0", "two", "2"),
            "yard/minutes.csv, line 3, column ch4_north_ppm: expected a number, was 'two'. Correct or empty the field.",
        ),
        (
            ("2030-01-01T00:01:00Z", "1", "0", "inf", "2"),
            "yard/minutes.csv, line 3, column ch4_north_ppm: expected a finite number, was inf. "
            "Empty the field where nothing was measured.",
        ),
        (
            ("2030-01-01T00:01:00Z", "1", "0", "2"),
            "yard/minutes.csv, line 3: expected 5 fields, as in the header, was 4.",
        ),
    ],
)
def test_a_wrong_row_is_told_in_one_sentence(tmp_path, second, said):
    with pytest.raises(MeasuredDataError) as error:
        network_of(bad_minutes(tmp_path, FIRST, second))
    assert str(error.value).splitlines()[0] == said


@pytest.mark.parametrize("fill", ["-9999", "-9999.0", "-999.9", "-6999", "1e20", "9.96921e36", "1e300", "-1", "-99"])
def test_values_that_stand_for_none_are_refused_by_line(tmp_path, fill):
    with pytest.raises(MeasuredDataError) as error:
        network_of(bad_minutes(tmp_path, FIRST, ("2030-01-01T00:01:00Z", "1", "0", fill, "2")))
    assert str(error.value).splitlines()[0] == (
        f"yard/minutes.csv, line 3, column ch4_north_ppm: expected a measured number, was {fill}, which stands for "
        "none, in 1 of 2 rows. Empty the field where nothing was measured."
    )


def test_winds_and_offsets_below_0_are_measured(tmp_path):
    rows = (("2030-01-01T00:01:00Z", "-1", "-9", "-1", "2"), ("2030-01-01T00:02:00Z", "1", "0", "-0.4", "2"))
    network = network_of(bad_minutes(tmp_path, FIRST, *rows))
    assert network.readings_ppm[1:, 0].tolist() == [-1, -0.4]


@pytest.mark.parametrize(
    ("file", "name", "other"),
    [
        ("minutes", "wind_east_m_s", "wind_east_km_h"),
        ("minutes", "ch4_south_ppm", "ch4_south_ppb"),
        ("releases", "rate_kg_h", "rate_g_s"),
        ("minutes", "time_utc", "time_s"),
    ],
)
def test_each_column_in_another_unit_is_told_with_both_names(tmp_path, file, name, other):
    path = write_network(tmp_path / "yard") / f"{file}.csv"
    path.write_text(path.read_text().replace(name, other))
    with pytest.raises(MeasuredDataError, match=rf"expected a column {name}, was {other}\. Convert column {other} and"):
        network_of(path.parent)


def test_readings_in_ppb_are_told_by_their_size(tmp_path):
    rows = [(f"2030-01-01T00:0{minute}:00Z", "1", "0", "2.0", "1950") for minute in range(3)]
    with pytest.raises(MeasuredDataError) as error:
        network_of(bad_minutes(tmp_path, *rows))
    assert str(error.value).splitlines()[0] == (
        "yard/minutes.csv, column ch4_south_ppm: expected methane in ppm, some 2 ppm most of the time and a median "
        "below 200, was a median of 1950. Divide by 1000 what is in ppb."
    )


def test_truth_of_another_site_is_refused(tmp_path):
    with pytest.raises(MeasuredDataError, match=r"expected one of tank, well, was stack\. Take the site.json of the"):
        network_of(write_network(tmp_path / "a", releases="1,2030-01-01T00:00:10Z,2030-01-01T00:00:50Z,stack,1.8"))
    with pytest.raises(MeasuredDataError, match=r"column start_utc: expected a time within the log, was 2031"):
        network_of(write_network(tmp_path / "b", releases="1,2031-01-01T00:00:10Z,2031-01-01T00:00:50Z,well,1.8"))
    with pytest.raises(
        MeasuredDataError, match=r"expected readings of the masts of site.json \(north, south\), was east"
    ):
        network_of(write_network(tmp_path / "c", masts=("north", "east")))


def test_a_folder_without_a_known_format_is_told_what_there_could_be(tmp_path):
    (tmp_path / "notes").mkdir()
    with pytest.raises(
        MeasuredDataError, match=r"mast_network \(site.json, minutes.csv\*, releases.csv\).*none of them"
    ):
        read_measured(tmp_path)
    with pytest.raises(MeasuredDataError, match="expected a folder of measured data, was nothing"):
        read_measured(tmp_path / "absent")


def test_lasers_are_read_with_absurd_scatter_as_missing(tmp_path):
    data = read_measured(write_lasers(tmp_path / "field", "source_9", tan_gammas=(0.3, 360)))
    paths = data.read(data.sets[0], LaserPaths)
    assert paths.sources[0].source == "source_9"
    assert paths.sources[0].rate_kg_s == 4e-4
    assert np.isnan(paths.sources[0].tan_gamma_horizontal).tolist() == [False, True]


def test_a_layout_without_the_source_of_a_file_is_refused(tmp_path):
    folder = write_lasers(tmp_path / "field", "source_9")
    (folder / "minutes_source_9.csv").rename(folder / "minutes_source_3.csv")
    data = read_measured(folder)
    with pytest.raises(MeasuredDataError, match=r"of which minutes_source_3.csv has readings, was source_9") as error:
        data.read(data.sets[0], LaserPaths)
    assert "expected source_3" in str(error.value)


def test_each_format_is_described_with_its_files():
    page = (Path(__file__).parents[4] / "docs" / "measured-data.md").read_text(encoding="utf-8")
    described = re.findall(r"^\| `(\w+)` \| (.*?) \|", page, flags=re.MULTILINE)
    assert [name for name, _ in described] == [each.name for each in FORMATS]
    for (_, files), each in zip(described, FORMATS, strict=True):
        listed = [name.replace("NN", "*").removesuffix("*") for name in re.findall(r"`([^`]+)`", files)]
        assert listed == [name.removesuffix("*") for name in each.files]


@needs_measured
def test_the_reference_sets_are_read():
    data = read_measured(MEASURED)
    found = {each.name: each.format for each in data.sets}
    assert len(found) == 8
    for each in data.sets:
        if each.format != "room_sensors":
            data.read(each, object)
    assert data.published("richardson_constant") == {"g": 0.5, "uncertainty": 0.2}
    metec = data.read(next(each for each in data.sets if each.name == "metec"), MastNetwork)
    assert metec.pressure_pa == 84_000.0
    assert set(metec.forward_ppm_s_g) == set(metec.places_m)


@pytest.mark.slow
@needs_measured
def test_the_room_of_sensors_is_read():
    data = read_measured(MEASURED / "orebro")
    room = data.read(data.sets[0], RoomSensors)
    assert len(room.sensors) == 27
    assert {each.readings_ppm.shape[1] for each in room.experiments} == {27}
