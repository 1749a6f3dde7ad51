"""What tests of all folders share."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from built_rooms import build_closed_room
from built_scenarios import NOSE, build_agent, build_scenario
from hypothesis import HealthCheck, settings
from marked_files import MISREAD, find_misread, is_left_out, is_whole_suite

from gslcosim.environment.geometry_source import build_unsolved_environment
from gslcosim.environment.model import Environment
from gslcosim.scenario import load_scenario
from gslcosim.scenario.models.scenario import Scenario

# The same examples every time: a law that fails must fail for everyone, and a slow machine is no failure.
# `HYPOTHESIS_PROFILE=explore` looks for new examples.
settings.register_profile(
    "repeatable", deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("explore", deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

GOLDEN_DIR = Path(__file__).parent / "tests" / "golden"
MARKS = ("slow", "end_to_end", "tour", "debian", "extras", "soak")
# A module's tests go to one worker. The longest modules begin first: begun last, one would run while no other does.
LONGEST_MODULES = (
    "test_core_alone", "test_ray_pool", "test_two_hosts", "test_sandboxes", "test_tutorials", "test_method_ports",
    "test_fork",
    "test_new_agents", "test_snapshots", "test_readme", "test_live", "test_machine_faults", "test_languages",
    "test_runner", "test_hostile_submissions", "test_get_started", "test_faults", "test_gateway",
    "test_transport_pages", "test_compose_run", "test_openfoam", "test_submission", "test_events", "test_methods",
    # Of those that start no processes.
    "test_foreign_folders", "test_wind_cases", "test_gas_pages", "test_pimplefoam", "test_extend_sensor",
    "test_reference_free_kernels", "test_heated_cavity", "test_docs_site", "test_reference_cases", "test_plots",
    "test_batch_equals_flight", "test_bundled_suites", "test_training", "test_exchange_fuzz",
)  # fmt: skip


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Pass over files that a mark leaves out, where the whole suite is collected."""
    return True if is_whole_suite(config) and is_left_out(collection_path, config) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the longest modules; before tests are left out, so that no misread mark is missed."""
    config.stash[MISREAD] = find_misread(items, MARKS)
    ranks = {name: rank for rank, name in enumerate(LONGEST_MODULES)}
    items.sort(key=lambda item: ranks.get(item.path.stem, len(ranks)))


@pytest.fixture(scope="session", autouse=True)
def _state_folder(tmp_path_factory: pytest.TempPathFactory):
    """What tests find out is not kept in the state of who runs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GSLCOSIM_STATE", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture
def golden() -> Callable[[str, str], None]:
    """Compare a text with the file of that name in tests/golden; `make golden` rewrites the files instead."""

    def check(name: str, text: str) -> None:
        path = GOLDEN_DIR / name
        if os.environ.get("GSLCOSIM_REWRITE_GOLDEN"):
            path.write_text(text, encoding="utf-8")
        assert text == path.read_text(encoding="utf-8"), f"{path} differs: `make golden` rewrites it, review the diff"

    return check


@pytest.fixture
def make_room() -> Callable[..., Environment]:
    """Build a closed room of 15 x 10 x 6 m with uniform wind (one velocity a frame) and named obstacles."""
    return build_closed_room


@pytest.fixture
def make_scenario() -> Callable[..., Scenario]:
    """Build a scenario of one agent, or one for each of the given changes to that agent's vehicle."""

    def build(*vehicles, mode="on_request", sensors=(NOSE,), **fields) -> Scenario:
        agents = [
            build_agent(
                f"agent_{i}",
                mode=mode,
                sensors=sensors,
                vehicle={"start_m": (3.0 + 2.0 * i, 3.0, 0.2), "hold_s": 0.5, **vehicle},
            )
            for i, vehicle in enumerate(vehicles or ({},))
        ]
        return build_scenario(*agents, **fields)

    return build


@pytest.fixture
def room_with_gate() -> Callable[..., tuple[Scenario, Environment]]:
    """Return a function that makes `event_door` with given events, and its rooms in even wind, as cores know them."""

    def build(*events: str, changes: Sequence[str] = ()) -> tuple[Scenario, Environment]:
        overrides = [f"events=[{', '.join(events)}]", *changes]
        loaded = load_scenario("event_door", overrides=overrides)
        return loaded.scenario, build_unsolved_environment(loaded.scenario, scenario_dir=loaded.directory)

    return build
