"""The one list of services, and what must agree with it."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.runtime.distributed.service_main import main
from gslcosim.runtime.services import (
    build_dataflow,
    default_services,
    find_service,
    get_block_service,
    get_upstream_rank,
    list_service_names,
)
from gslcosim.scenario import load_scenario
from gslcosim.scenario.models.participants import ServiceSpec

ROOT = Path(__file__).parents[3]
NAMES = [kind.name for kind in default_services()]


@pytest.fixture(scope="module")
def everything():
    """Return a scenario that needs every service."""
    camera = "agents[0].sensors=[{model: tgs2600, name: nose}, {model: camera, name: eye}]"
    return load_scenario("swarm_tiny", overrides=[camera, "events=[{what: source_stops, at_s: 3}]", "ros2={}"]).scenario


def test_an_old_egg_info_in_the_working_folder_hides_no_service(tmp_path, monkeypatch):
    """Checkouts of some days keep one, which `python -m gslcosim` finds first."""
    (tmp_path / "gslcosim.egg-info").mkdir()
    (tmp_path / "gslcosim.egg-info" / "PKG-INFO").write_text("Metadata-Version: 2.1\nName: gslcosim\nVersion: 0.1.0\n")
    (tmp_path / "gslcosim.egg-info" / "entry_points.txt").write_text("[console_scripts]\ngslcosim = gslcosim:main\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    default_services.cache_clear()
    assert [kind.name for kind in default_services()] == NAMES


def test_each_service_is_called_as_its_own_dataflow_says(everything):
    assert (
        [kind.build_spec(everything).name for kind in default_services()]
        == NAMES
        == list(list_service_names(everything))
    )


def test_the_list_is_in_the_order_in_which_services_wait_for_each_other(everything):
    order = sorted(build_dataflow(everything).order, key=get_upstream_rank)
    dataflow = build_dataflow(everything)
    place = {name: i for i, name in enumerate(order)}
    for name in order:
        for read in dataflow.by_name[name].reads:
            if read.delay_ticks == 0:
                assert place[dataflow.writer_of[read.port]] < place[name], f"{name} reads {read.port}"


def test_services_that_a_scenario_has_no_use_for_are_left_out():
    quiet = load_scenario("tiny_room", overrides=["recording.enabled=false"]).scenario
    assert list_service_names(quiet) == ("world", "fields", "sensing", "referee")


def test_a_service_that_the_run_does_not_have_is_refused_by_name():
    scenario = load_scenario("tiny_room").scenario
    with pytest.raises(UsageError, match=r"expected one of world, fields, sensing, referee, recorder, .*, was 'radio'"):
        find_service("radio", scenario)


def test_the_table_of_the_architecture_has_each_service():
    table = (ROOT / "ARCHITECTURE.md").read_text().split("## Dataflow")[1].split("## ")[0]
    rows = re.findall(r"^\| (\w+)", table, re.MULTILINE)
    assert sorted(set(rows) & set(NAMES)) == sorted(NAMES)


def test_a_window_is_that_of_ordinary_readers_and_others_keep_their_proportion():
    scenario = load_scenario("tiny_room").scenario
    usual, wide = build_dataflow(scenario), build_dataflow(scenario, window_ticks=1024)
    assert usual.by_name["fields"].window_ticks == 256
    assert {p.name: p.window_ticks for p in wide.participants} == {
        p.name: 4 * p.window_ticks for p in usual.participants
    }


def test_compose_starts_services_of_the_list_only():
    started = re.findall(r"/join/services/\w+\.json, (\w+)\]", (ROOT / "compose.yaml").read_text())
    assert started == list(list_service_names(load_scenario("warehouse_empty").scenario))


def test_the_shell_wants_names_and_shows_all(capsys):
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 2
    output = capsys.readouterr().err
    assert all(name in output for name in NAMES)


def test_a_block_for_which_no_service_is_registered_is_named():
    class Unregistered(ServiceSpec):
        name: str = "unregistered"

    with pytest.raises(UsageError, match=r"a service for 'unregistered', found none\. Register one for Unregistered"):
        get_block_service(Unregistered())


def test_a_service_of_a_package_replaces_the_own_one_of_its_name_at_its_place():
    class OtherFields(ServiceSpec):
        name: str = "fields"

    replacement = replace(find_service("fields", load_scenario("tiny_room").scenario), is_warmed_up=False)
    get_block_service.register(OtherFields, lambda block: replacement)
    scenario = load_scenario("tiny_room").scenario.model_copy(update={"services": (OtherFields(),)})
    assert list_service_names(scenario) == ("world", "fields", "sensing", "referee", "recorder")
    assert find_service("fields", scenario) is replacement


def test_a_service_called_otherwise_than_its_block_is_refused():
    class Misnamed(ServiceSpec):
        name: str = "ventilation"

    get_block_service.register(Misnamed, lambda block: default_services()[0])
    scenario = load_scenario("tiny_room").scenario.model_copy(update={"services": (Misnamed(),)})
    with pytest.raises(UsageError, match="expected a service called 'ventilation', was 'world'"):
        list_service_names(scenario)
