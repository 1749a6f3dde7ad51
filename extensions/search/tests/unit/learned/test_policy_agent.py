import numpy as np
import pytest
from briefings import briefing, observation
from policies import NAMES, gru, table

from gslcosim.base.bundled import bundled_agents
from gslcosim.base.errors import MethodError
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_search.learned.policy import ActionSettings, PolicyError
from gslcosim_search.learned.policy_agent import match_observations
from gslcosim_search.learned.policy_files import save_policy
from gslcosim_search.learned.recurrent_networks import GruPolicy

Learned = load_python_agent(bundled_agents()["learned"])


def flown(agent, n=5):
    """Return the commands upon gas that comes and goes, in a wind from +y."""
    readings = [{"nose": 50_000.0, "nose_ppm": 3.0 * (i % 3), "vane": (0.5, 1.57)} for i in range(n)]
    return [agent.decide(observation(tick=40 + 10 * i, readings=one)) for i, one in enumerate(readings)]


@pytest.mark.parametrize(("make", "kind"), [(gru, "velocity"), (table, "waypoint")])
def test_it_flies_a_file_with_the_files_own_settings(tmp_path, make, kind):
    save_policy(tmp_path / "mine.npz", make(), {})
    agent_briefing = briefing(parameters={"policy": str(tmp_path / "mine.npz")})
    commands = flown(Learned(agent_briefing))
    assert {command.kind for command in commands} <= {kind, "hold"}
    assert {command.hold_s for command in commands} == {make().action.hold_s}
    assert flown(Learned(agent_briefing)) == commands


def test_a_policy_may_see_and_command_in_the_wind_frame(tmp_path):
    """With the wind from +y, upwind is +y: the same policy in the world frame flies a quarter of a turn away."""
    names = ("nose_ppm.amount", "bouts.since", "wind_frame.v_upwind")
    commanded = {}
    for frame in ("world", "wind"):
        action = ActionSettings(kind="velocity", speed_m_s=0.5, hold_s=0.5, frame=frame)
        policy = gru(names=names)
        save_policy(tmp_path / f"{frame}.npz", GruPolicy.of_arrays(names, action, policy.arrays, {"spread": 0.0}), {})
        agent = Learned(briefing(parameters={"policy": str(tmp_path / f"{frame}.npz")}))
        commanded[frame] = np.array([command.velocity_world_m_s for command in flown(agent)])
    x_m_s, y_m_s, _ = commanded["world"].T
    assert np.hypot(x_m_s, y_m_s).max() > 0.01
    np.testing.assert_allclose(commanded["wind"].T, [-y_m_s, x_m_s, np.zeros(5)], atol=2e-3)


def test_a_bundled_policy_is_flown_by_its_name():
    assert flown(Learned(briefing(parameters={"policy": "learned"}))) == flown(Learned(briefing()))


def test_what_is_no_policy_is_reported(tmp_path):
    with pytest.raises(MethodError, match=r"policy: expected one of .*learned.*, was 'learner'\. .*may_read"):
        Learned(briefing(parameters={"policy": "learner"}))
    (tmp_path / "p.npz").write_bytes(b"PK")
    with pytest.raises(MethodError, match=r"can be read.*\nFile: .*p\.npz"):
        Learned(briefing(parameters={"policy": str(tmp_path / "p.npz")}))


def test_a_policy_takes_what_it_names_in_its_own_order():
    assert match_observations(gru(), ("x", "wind.from_cos", "nose.amount", "refused", "wind.from_sin")) == [3, 2, 4, 1]


def test_a_sensor_of_another_name_fits_where_it_is_the_only_one_that_shows_this():
    assert match_observations(gru(), ("refused", "mox_ppm.amount", "vane.from_sin", "vane.from_cos")) == [0, 1, 2, 3]
    with pytest.raises(
        PolicyError, match=r"expected nose\.amount .*, was missing; not used are a\.amount, b\.amount\."
    ):
        match_observations(gru(), ("refused", "a.amount", "b.amount", "vane.from_sin", "vane.from_cos"))


def test_what_is_missing_and_what_is_there_instead_are_named():
    with pytest.raises(PolicyError, match=r"wind\.from_sin, wind\.from_cos .* not used are x, nose\.log_resistance\."):
        match_observations(gru(), ("x", "refused", "nose.log_resistance", "nose.amount"))
    assert len(NAMES) == 4
