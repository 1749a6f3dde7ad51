import itertools
import math

import pytest
from briefings import briefing, observation
from ribbon_world import Ribbon, fly

from gslcosim_agents.silkmoth.agent import Silkmoth

WEST_RAD = math.pi  # the wind comes from -x
MOUNTS_M = ((0.0, 0.25, 0.0), (0.0, -0.25, 0.0))
PAIR = (("pid", "left", MOUNTS_M[0]), ("pid", "right", MOUNTS_M[1]), ("anemometer", "vane"))


def made(**changes):
    return Silkmoth(briefing(**{"sensors": PAIR, **changes}))


def at(tick, *, left=0.0, right=0.0, place_m=(7.0, 5.0, 2.0), upwind_rad=WEST_RAD):
    return observation(
        tick=tick, position_m=place_m, readings={"left": left, "right": right, "vane": (0.5, upwind_rad)}
    )


def speed_and_heading(command):
    x, y, _ = command.velocity_world_m_s
    return math.hypot(x, y), math.atan2(y, x)


@pytest.mark.parametrize(("side", "nose"), [(1, "left"), (-1, "right")])
def test_after_a_whiff_it_runs_the_moths_programme(side, nose):
    """Speeds and turn rates of the commands, a tenth of a second apart, are those of the timeline."""
    agent = made()
    commands = [agent.decide(at(10, **{nose: 1.0}))]
    commands += [agent.decide(at(11 + i)) for i in range(30)]
    speeds, headings = zip(*map(speed_and_heading, commands), strict=True)
    assert speeds[:5] == pytest.approx([0.5] * 5)
    assert speeds[5:] == pytest.approx([0.5 * 0.8 / 19.0] * 26)
    rates = [side * math.remainder(b - a, math.tau) / 0.1 for a, b in itertools.pairwise(headings[4:])]
    assert rates[:7] == pytest.approx([1.3] * 7)
    assert rates[7:14] == pytest.approx([-1.3] * 7)
    assert rates[14:16] == pytest.approx([1.3] * 2)
    assert rates[16:] == pytest.approx([-1.3] * len(rates[16:]))


def test_a_whiff_at_any_time_begins_a_new_surge():
    agent = made()
    agent.decide(at(10, left=1.0))
    for tick in range(11, 40):
        agent.decide(at(tick))
    assert speed_and_heading(agent.decide(at(40, right=1.0)))[0] == pytest.approx(0.5)


def test_without_a_whiff_for_long_it_explores():
    agent = made()
    agent.decide(at(10, left=1.0))
    assert speed_and_heading(agent.decide(at(80)))[0] < 0.1
    assert speed_and_heading(agent.decide(at(95)))[0] == pytest.approx(1.0)


@pytest.mark.parametrize(("place_m", "axis", "sign"), [((0.3, 5.0, 2.0), 0, -1), ((7.0, 9.8, 2.0), 1, 1)])
def test_it_does_not_fly_out_of_the_margin(place_m, axis, sign):
    agent = made()
    for tick in range(10, 60):
        velocity = agent.decide(at(tick, left=1.0, place_m=place_m, upwind_rad=WEST_RAD if axis == 0 else math.pi / 2))
        assert sign * velocity.velocity_world_m_s[axis] <= 0.0


@pytest.mark.parametrize(("z_m", "climb_m_s"), [(2.0, 0.0), (1.8, 0.2), (9.0, -0.5)])
def test_it_keeps_its_height(z_m, climb_m_s):
    command = made().decide(at(10, place_m=(7.0, 5.0, z_m)))
    assert command.velocity_world_m_s[2] == pytest.approx(climb_m_s)


@pytest.mark.parametrize("nose", ["pid", "binary"])
def test_it_comes_up_a_ribbon_of_gas(nose):
    assert fly(Silkmoth, Ribbon(), nose=nose, mounts_m=MOUNTS_M, limit_s=120.0).found_s is not None
