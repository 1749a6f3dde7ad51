"""docs/extend/service.md: every step is carried out, on a copy."""

import base64
import json
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

PAGE = (Path(__file__).parents[2] / "docs" / "extend" / "service.md").read_text()
FAILED_THE_TASK = 1


@pytest.fixture(scope="module")
def package(lay_out_package, tmp_path_factory):
    return lay_out_package(PAGE, tmp_path_factory.mktemp("ventilation"))


@pytest.fixture
def words(find_words):
    return find_words(PAGE)


def flown(words, package, gslcosim_with, folder):
    folder.mkdir()
    # Gas is about from the start, and the search is not over before it is met.
    short = ["--set", "referee.stop.time_limit_s=12", "--set", "referee.success.within_m=0.01"]
    done = gslcosim_with(package, [*words, *short], folder)
    assert done.returncode == FAILED_THE_TASK, done.stdout + done.stderr
    (digest,) = folder.glob("runs/*/digest.json")
    return json.loads(digest.read_text())


@pytest.mark.slow
@pytest.mark.end_to_end
def test_a_service_of_a_package_runs_in_one_process_and_in_many_with_one_digest(
    package, gslcosim_with, tmp_path, find_words
):
    words = find_words(PAGE)
    alone = flown([*words, "--in-process"], package, gslcosim_with, tmp_path / "alone")
    many = flown(words, package, gslcosim_with, tmp_path / "many")
    assert alone["ports"]["ventilation/state"]["participant"] == "ventilation"
    assert len(alone["ports"]["ventilation/state"]["ticks"]) == 121
    assert alone["digest"] == many["digest"]
    assert list((tmp_path / "many").glob("runs/*/logs/ventilation.log"))


def first_difference(a, b, port):
    links = [base64.b64decode(run["ports"][port]["links"]) for run in (a, b)]
    return next(i // 8 for i in range(0, min(map(len, links)), 8) if links[0][i : i + 8] != links[1][i : i + 8])


@pytest.mark.slow
@pytest.mark.end_to_end
def test_wind_and_gas_react_a_tick_after_gas_was_met_and_the_recording_shows_it(
    package, gslcosim_with, tmp_path, find_words
):
    words = find_words(PAGE)
    driven = flown([*words, "--in-process"], package, gslcosim_with, tmp_path / "driven")
    calm = flown(["up", "tiny_room", "--in-process"], package, gslcosim_with, tmp_path / "calm")
    (recording,) = (tmp_path / "driven").glob("runs/*/recording.rrd")
    shares = curve(recording, "/plots/services/truth/wind/share")
    in_gas = curve(recording, "/plots/services/ventilation/state/is_in_gas")
    assert len(shares) == len(in_gas) == 121
    met = in_gas.index(1.0)
    assert shares[:met] == [1.0] * met
    assert shares[met] == pytest.approx(1.1)
    assert max(shares) <= 3.0
    # Written in one tick, felt in the next.
    assert first_difference(driven, calm, "truth/bodies") == first_difference(driven, calm, "truth/samples") == met + 1


def curve(recording, entity):
    values = {}
    for chunk in RrdReader(recording).store().stream().to_chunks():
        batch = chunk.to_record_batch()
        if str(chunk.entity_path) == entity:
            (column,) = (name for name in batch.schema.names if "scalars" in name)
            rows = zip(batch.column("tick").to_pylist(), batch.column(column).to_pylist(), strict=True)
            values |= {tick: value for tick, (value,) in rows}
    assert list(values) == sorted(values)
    return list(values.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "found"),
    [
        ("gas.tape=true", "gas.tape: true"),
        ("gas.model=gaussian_plume", "gas.model: gaussian_plume"),
    ],
)
def test_gas_that_would_not_follow_is_refused(package, gslcosim_with, tmp_path, setting, found):
    words = ["validate", "tiny_room", "--set", "services=[{name: ventilation}]", "--set", setting]
    done = gslcosim_with(package, words, tmp_path)
    assert done.returncode == 2
    expected = "services: expected none that changes the wind, as ventilation does, with gas that does not follow it"
    assert f"{expected}, was {found}" in done.stdout + done.stderr
