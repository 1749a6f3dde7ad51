import pytest
from briefings import briefing, observation

from gslcosim_agents.c_pso.agent import CPso

MEMBERS = ("a", "b", "c", "d")


def made(name: str, **parameters) -> CPso:
    return CPso(briefing(sensors=(("pid", "nose"),), members=MEMBERS, name=name, parameters=parameters))


def pushed(agent: CPso, *heard: tuple[str, str]) -> list[float]:
    """What the charges add to the step of a robot at (7, 5)."""
    question = observation(readings={"nose": 1.0}, heard=heard, name=agent.team.name)
    agent.observe(question)
    agent.take(question)
    return agent.push_m().tolist()


@pytest.mark.parametrize(
    ("share", "charged"), [(0.5, {"a", "b"}), (0.0, set()), (1.0, set(MEMBERS)), (0.3, {"a", "b"})]
)
def test_the_first_by_name_are_charged_and_all_agree_who(share, charged):
    for name in MEMBERS:
        assert made(name, charged_frac=share).charged == charged


def test_charges_push_each_other_and_no_other():
    text = "g 39 700 700 200 0"  # 2 m to the north
    assert pushed(made("a"), ("b", text)) == pytest.approx([0.0, -0.25])
    assert pushed(made("a"), ("c", text)) == [0.0, 0.0]
    assert pushed(made("c"), ("a", text)) == [0.0, 0.0]
    assert pushed(made("a"), ("b", "g 39 700 1200 200 0")) == [0.0, 0.0]  # beyond the reach of 5 m
