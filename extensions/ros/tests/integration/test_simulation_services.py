"""ROS 2 nodes step a simulation by the services and the action of `simulation_interfaces`, and ask for gas and wind."""

import json
import queue
import threading
from pathlib import Path

import numpy as np
import pytest
from free_endpoints import find_free_endpoint

from gslcosim.base.bundled import bundled_scenarios
from gslcosim.cli.main import main
from gslcosim.simulation.simulation import Simulation

rosbags = pytest.importorskip("rosbags", reason="needs the extra ros")
pytest.importorskip("xxhash", reason="needs the extra ros")
from gslcosim_ros import simulation_interfaces as interfaces  # noqa: E402
from gslcosim_ros.actions import ActionClient, CancelCode, GoalStatus  # noqa: E402
from gslcosim_ros.node import RosSession  # noqa: E402
from gslcosim_ros.ros_graphs import ROS_DISTRIBUTIONS  # noqa: E402
from gslcosim_ros.simulation_interfaces import Feature, ResultCode, State, define_interfaces  # noqa: E402
from gslcosim_ros.simulation_services import SimulationServices, encode_gas_response  # noqa: E402
from gslcosim_ros.types import RosTypes  # noqa: E402

pytestmark = [pytest.mark.extras, pytest.mark.slow]
PATIENCE_S = 120.0
OK, FAILED = ResultCode.OK, ResultCode.OPERATION_FAILED
# A flight that steps freely reaches a limit of an hour within seconds, before the next request on a busy machine.
OVERRIDES = ["referee.stop.time_limit_s=360000", "referee.success.within_m=0.000001"]
# Of the code that ROS's own generator has written for version 2.
HASHES = json.loads(Path(__file__).with_name("simulation_interfaces_hashes.json").read_text())


@pytest.mark.parametrize("distribution", ROS_DISTRIBUTIONS[1:])
def test_types_have_the_hashes_of_ros(distribution):
    types = RosTypes(distribution)
    define_interfaces(types)
    assert {kind: types.hash(f"{interfaces.PACKAGE}/{kind}") for kind in HASHES} == HASHES


def test_a_response_about_gas_has_the_bytes_of_its_type():
    types = RosTypes("jazzy")
    define_interfaces(types)
    for n_points in (0, 1, 3):
        for gases in (("ethanol",), ("ethanol", "methane")):
            ppm = np.arange(n_points * len(gases), dtype=np.float64).reshape(n_points, len(gases)) + 0.5
            cells = [types.make("gaden_msgs/msg/GasInCell", concentration=row) for row in ppm]
            message = types.make(f"{interfaces.GADEN_GAS}_Response", positions=cells, gas_type=list(gases))
            assert encode_gas_response(ppm, gases) == types.to_cdr(message)


@pytest.fixture(scope="module")
def served():
    """A simulation with its services, and what calls one of them."""
    endpoint, reports = find_free_endpoint(), queue.SimpleQueue()
    theirs = RosTypes("jazzy")
    define_interfaces(theirs)
    with (
        RosSession.open(RosTypes("jazzy"), endpoint=endpoint, report=reports.put) as session,
        Simulation("tiny_room", seed=3, overrides=OVERRIDES) as simulation,
        RosSession.open(theirs, endpoint=endpoint) as other,
    ):
        services = SimulationServices(simulation, session, pace=20)
        node = other.create_node("orchestrator")
        clients = {}

        def call(name, kind=None, timeout_s=PATIENCE_S, **fields):
            kind = kind or interfaces.get_service_type("".join(part.title() for part in name.split("_")))
            path = name if name.startswith("/") else f"/gslcosim/{name}"
            if path not in clients:
                other.wait_for("SS", path, PATIENCE_S)
                clients[path] = node.create_client(path, kind)
            blank = theirs.store.types[f"{kind}_Request"]
            if "structure_needs_at_least_one_member" in blank.__dataclass_fields__:
                fields = {"structure_needs_at_least_one_member": 0}
            return clients[path].call(theirs.make(f"{kind}_Request", **fields), timeout_s=timeout_s)

        def set_state(state):
            wanted = theirs.make("simulation_interfaces/msg/SimulationState", state=int(state))
            return call("set_simulation_state", state=wanted).result

        yield simulation, services, call, set_state, theirs, endpoint


@pytest.fixture
def paused(served):
    """The same, paused before its first tick."""
    served[2]("reset_simulation", scope=0)
    return served


def build_filters(types, *, name="", categories=(), tags=(), mode=0, bounds=0, points=()):
    package = "simulation_interfaces/msg/"
    return types.make(
        f"{package}EntityFilters", filter=name, bounds=types.make(f"{package}Bounds", type=bounds, points=list(points)),
        categories=[types.make(f"{package}EntityCategory", category=each) for each in categories],
        tags=types.make(f"{package}TagsFilter", tags=list(tags), filter_mode=mode),
    )  # fmt: skip


def test_a_thousand_single_steps_are_one_run_and_a_reset_is_a_fresh_start(paused):
    simulation, _, call, _, _, _ = paused
    assert call("step_simulation", steps=1000).result.result == OK
    digest = simulation.digest
    assert simulation.tick == 999
    for scope in (0, 3, 255):
        assert call("reset_simulation", scope=scope).result.result == OK
        assert simulation.tick == -1
    for scope in (1, 2, 4):
        assert call("reset_simulation", scope=scope).result.result == ResultCode.FEATURE_UNSUPPORTED
    assert {call("step_simulation", steps=1).result.result for _ in range(1000)} == {OK}
    assert simulation.digest == digest


def test_states_change_as_the_standard_says_and_only_a_paused_simulation_is_stepped(paused):
    simulation, _, call, set_state, _, _ = paused

    def get_state():
        return call("get_simulation_state").state.state

    assert get_state() == State.PAUSED
    assert set_state(State.PAUSED).result == ResultCode.ALREADY_IN_TARGET_STATE
    assert set_state(State.PLAYING).result == OK
    assert get_state() == State.PLAYING
    refused = call("step_simulation", steps=1).result
    assert (refused.result, refused.error_message) == (FAILED, "Expected state PAUSED, was PLAYING. Pause it first.")
    assert set_state(State.PAUSED).result == OK
    assert get_state() == State.PAUSED
    assert set_state(State.STOPPED).result == OK
    assert (get_state(), simulation.tick) == (State.STOPPED, -1)
    assert call("step_simulation", steps=1).result.result == FAILED
    assert set_state(State.PAUSED).result == OK
    assert call("step_simulation", steps=2).result.result == OK
    assert simulation.tick == 1
    assert set_state(77).result == FAILED
    assert call("step_simulation", steps=0).result.result == FAILED
    # Who does not wait for the answer holds up nobody.
    with pytest.raises(TimeoutError):
        call("step_simulation", steps=300, timeout_s=0.01)
    assert call("step_simulation", steps=1).result.result == OK
    assert simulation.tick == 302
    # Nor who asks for steps without end: a new state ends them.
    with pytest.raises(TimeoutError):
        call("step_simulation", steps=2**63, timeout_s=0.2)
    assert set_state(State.STOPPED).result == OK
    assert (get_state(), simulation.tick) == (State.STOPPED, -1)


def test_an_action_simulates_steps_tells_of_each_and_can_be_canceled(paused):
    simulation, _, call, set_state, _, endpoint = paused
    types, told = RosTypes("jazzy"), queue.SimpleQueue()
    define_interfaces(types)
    with RosSession.open(types, endpoint=endpoint) as session:
        path, kind = "/gslcosim/simulate_steps", interfaces.SIMULATE_STEPS
        client = ActionClient(session, session.create_node("stepper"), path, kind, told.put)
        session.wait_for("SS", f"{path}/_action/get_result", PATIENCE_S)

        def simulate(n_steps):
            return client.send_goal(types.make(f"{kind}_Goal", steps=n_steps), timeout_s=PATIENCE_S)

        def wait_for_result(goal_id):
            status, result = client.wait_for_result(goal_id, timeout_s=PATIENCE_S)
            return status, result.result.result, result.result.error_message

        assert wait_for_result(simulate(20)) == (GoalStatus.SUCCEEDED, OK, "")
        assert simulation.tick == 19
        feedback = [told.get(timeout=PATIENCE_S) for _ in range(20)]
        assert [(each.completed_steps, each.remaining_steps) for each in feedback] == [
            (n, 20 - n) for n in range(1, 21)
        ]
        goal_id = simulate(1_000_000)
        told.get(timeout=PATIENCE_S)
        # One that waits for its turn is canceled at once, and makes no step.
        waiting = simulate(5)
        assert client.cancel_goal(waiting, timeout_s=PATIENCE_S) == CancelCode.NONE
        nothing_done = (GoalStatus.CANCELED, FAILED, "It went 0 of 5 steps: it was canceled.")
        assert wait_for_result(waiting) == nothing_done
        assert client.cancel_goal(goal_id, timeout_s=PATIENCE_S) == CancelCode.NONE
        status, code, text = wait_for_result(goal_id)
        n_done = simulation.tick - 19
        assert (status, code) == (GoalStatus.CANCELED, FAILED)
        assert text == f"It went {n_done} of 1000000 steps: it was canceled."
        goal_id = simulate(2**63)
        # It has begun when feedback of it is there: a goal that begins after the reset goes on.
        while told.get(timeout=PATIENCE_S).remaining_steps < 2**62:
            pass
        assert call("reset_simulation", scope=0).result.result == OK
        status, _, text = wait_for_result(goal_id)
        assert (status, text.split(": ")[1]) == (GoalStatus.ABORTED, "another request has set the state.")
        assert wait_for_result(simulate(0))[:2] == (GoalStatus.ABORTED, FAILED)
        assert set_state(State.PLAYING).result == OK
        refused = (GoalStatus.ABORTED, FAILED, "Expected state PAUSED, was PLAYING. Pause it first.")
        assert wait_for_result(simulate(1)) == refused
        assert set_state(State.PAUSED).result == OK
        # The goal of one who leaves goes on, and others may ask how it ended.
        tick = simulation.tick
        with RosSession.open(types, endpoint=endpoint) as leaving:
            other = ActionClient(leaving, leaving.create_node("leaver"), path, kind)
            leaving.wait_for("SS", f"{path}/_action/send_goal", PATIENCE_S)
            goal_id = other.send_goal(types.make(f"{kind}_Goal", steps=50), timeout_s=PATIENCE_S)
        assert wait_for_result(goal_id) == (GoalStatus.SUCCEEDED, OK, "")
        assert simulation.tick == tick + 50
    assert call("step_simulation", steps=1).result.result == OK


def test_features_and_entities_are_those_that_there_are(paused):
    simulation, _, call, _, types, _ = paused
    assert list(call("get_simulator_features").features.features) == [int(feature) for feature in Feature]
    call("step_simulation", steps=20)

    def find(**filters):
        answer = call("get_entities", filters=build_filters(types, **filters))
        return answer.result.result, answer.entities

    assert find() == find(name="^bee", categories=[2], tags=["iris"]) == (OK, ["beetle"])
    assert find(name="moth") == find(categories=[3]) == find(tags=["iris", "rover"], mode=1) == (OK, [])
    body = simulation.truth.bodies["beetle"]
    sphere = [types.vector(np.array(body.position_world_m)), types.vector(np.array([0.1, 0.0, 0.0]))]
    assert find(bounds=3, points=sphere) == (OK, ["beetle"])
    assert find(bounds=3, points=[types.vector(np.zeros(3)), sphere[1]]) == (OK, [])
    assert find(name="(")[0] == find(bounds=3, points=sphere[:1])[0] == FAILED
    # Backtracking would hold up everything for longer than the test lasts.
    refused = (
        "(.*)*(.*)*(.*)*(.*)*(.*)*Z",
        ".?" * 60 + "Z",
        r"[\][](.*)*(.*)*(.*)*(.*)*Z]",
        "(?x)(.*) *",
        "a{9999999999999}",
    )
    assert {find(name=name)[0] for name in refused} == {FAILED}
    assert find(name=r"^b[a-z]*(tle)?$") == (OK, ["beetle"])
    assert find(bounds=1, points=sphere)[0] == ResultCode.FEATURE_UNSUPPORTED
    state = call("get_entity_state", entity="beetle").state
    both = call("get_entities_states", filters=build_filters(types))
    assert (both.entities, both.states[0].pose) == (["beetle"], state.pose)
    position, stamp = state.pose.position, state.header.stamp
    assert (position.x, position.y, position.z) == body.position_world_m
    assert (state.header.frame_id, stamp.sec, stamp.nanosec) == ("map", 1, 900_000_000)
    assert state.twist.linear.z == body.velocity_world_m_s[2]
    info = call("get_entity_info", entity="beetle").info
    assert (info.category.category, info.tags, info.description) == (2, ["iris"], "iris with the method dung_beetle")
    for name in ("get_entity_state", "get_entity_info"):
        missing = call(name, entity="moth").result
        assert (missing.result, missing.error_message) == (
            ResultCode.NOT_FOUND, "entity: expected one of beetle, was 'moth'.",
        )  # fmt: skip


def test_gas_and_wind_of_gaden_are_those_of_sample(paused, tmp_path):
    _, _, call, _, _, _ = paused
    call("step_simulation", steps=51)
    rows = np.array([(1.6 + 0.05 * i, 2.0 + 0.01 * i, 1.0) for i in range(20)] + [(99.0, 0.0, 0.0)])
    fields = dict(zip("xyz", np.ascontiguousarray(rows.T), strict=True))
    gas, wind = (
        call("/odor_value", interfaces.GADEN_GAS, **fields),
        call("/wind_value", interfaces.GADEN_WIND, **fields),
    )
    assert gas.gas_type == ["ethanol"]
    ppm = np.array([cell.concentration for cell in gas.positions])
    wind_m_s = np.column_stack([wind.u, wind.v, wind.w])
    # Outside the room there is nothing, as GADEN has it.
    assert (ppm[-1], *wind_m_s[-1]) == (0.0, 0.0, 0.0, 0.0)
    points = tmp_path / "points.csv"
    points.write_text("x_m,y_m,z_m\n" + "".join(f"{x},{y},{z}\n" for x, y, z in rows[:-1].tolist()))
    scenario = tmp_path / "room.yaml"
    scenario.write_text(bundled_scenarios()["tiny_room"].read_text().replace("\nseed: 1\n", "\nseed: 3\n"))
    for quantity, expected in (("gas", ppm), ("wind", wind_m_s)):
        out = tmp_path / f"{quantity}.csv"
        words = ["environment", "sample", str(scenario), "--time", "5", "--points", str(points), "--out", str(out)]
        assert main([*words, "--quantity", quantity]) == 0
        values = np.loadtxt(out, delimiter=",", skiprows=1)[:, 3 : 3 + expected.shape[1]]
        np.testing.assert_allclose(expected[:-1], values, rtol=1e-6)
    with pytest.raises(ValueError, match="expected as many x as y and z, was 21, 1 and 21"):
        call("/odor_value", interfaces.GADEN_GAS, x=rows[:, 0].copy(), y=np.zeros(1), z=rows[:, 2].copy())
    assert call("step_simulation", steps=1).result.result == OK


def test_the_command_serves_until_a_client_lets_it_quit(capsys):
    endpoint = find_free_endpoint()
    codes = []
    words = ["step", "tiny_room", "--ros2", "--ros-distro", "kilted", "--set", f"ros2={{endpoint: '{endpoint}'}}"]
    server = threading.Thread(target=lambda: codes.append(main(words)))
    server.start()
    types = RosTypes("kilted")
    define_interfaces(types)
    with RosSession.open(types, endpoint=endpoint) as session:
        kind = interfaces.get_service_type("SetSimulationState")
        session.wait_for("SS", "/gslcosim/set_simulation_state", PATIENCE_S)
        client = session.create_node("orchestrator").create_client("/gslcosim/set_simulation_state", kind)
        quitting = types.make("simulation_interfaces/msg/SimulationState", state=int(State.QUITTING))
        assert client.call(types.make(f"{kind}_Request", state=quitting), timeout_s=PATIENCE_S).result.result == OK
    server.join(PATIENCE_S)
    assert codes == [0]
