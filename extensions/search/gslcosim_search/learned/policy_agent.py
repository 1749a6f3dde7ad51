"""Agent that runs a learned policy."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.learned.encoding import WIND, ObservationVector, action_kind, turn_actions
from gslcosim_search.learned.policy import Policy, PolicyError
from gslcosim_search.learned.policy_files import load_policy
from gslcosim_search.learned.shield import VelocityShield
from gslcosim_search.learned.wind_frame import asks_wind_frame

# The file of a policy that is an agent of its own, beside its program.
POLICY_FILE = "policy.npz"


def match_observations(policy: Policy, offered: Sequence[str]) -> list[int]:
    """Return the place of each observation of a policy among those that an agent has.

    A scenario names its sensors as it likes: a number of a sensor whose name is not there is that of the only sensor
    that tells a number of this kind, `nose.amount` for example that of a PID with the name `pid`.

    Args:
        offered: `ObservationVector.names` of the agent.

    Raises:
        PolicyError: an observation is not there, or several sensors could be meant.
    """
    places = [_place_of(name, offered) for name in policy.observation_names]
    missing = [name for name, place in zip(policy.observation_names, places) if place is None]
    if missing:
        used = set(places)
        others = [name for i, name in enumerate(offered) if i not in used]
        raise PolicyError(
            f"observations: expected {', '.join(missing)} for this policy, was missing; not used are "
            f"{', '.join(others) or 'none'}. Give the agent sensors that tell it, by these names."
        )
    return [place for place in places if place is not None]


def _place_of(name: str, offered: Sequence[str]) -> int | None:
    if name in offered:
        return offered.index(name)
    _, dot, number = name.rpartition(".")
    like = [i for i, other in enumerate(offered) if other.rpartition(".")[1:] == (dot, number)]
    return like[0] if dot and len(like) == 1 else None


class PolicyRunner:
    """Turns what an agent observes into what a policy observes, and what it chooses into commands.

    Args:
        briefing: Of the agent.
        policy: What decides.

    Raises:
        PolicyError: the agent lacks something that the policy observes.
    """

    def __init__(self, briefing: Briefing, policy: Policy) -> None:
        self.policy = policy
        self._is_turned = policy.action.frame == WIND
        needs_frame = self._is_turned or asks_wind_frame(policy.observation_names)
        self._vector = ObservationVector(briefing, has_wind_frame=needs_frame)
        self._places = np.array(match_observations(policy, self._vector.names))
        settings = policy.action
        self._actions = action_kind(
            settings.kind, briefing, step_m=settings.step_m, speed_m_s=settings.speed_m_s, hold_s=settings.hold_s
        )
        self._shield: VelocityShield | None = None
        if settings.shield_m is not None:
            self._shield = VelocityShield(
                briefing, self._vector.names, keep_m=settings.shield_m, speed_m_s=settings.speed_m_s,
                hold_s=settings.hold_s,
            )  # fmt: skip
        self._memory = policy.memory(1)

    def decide(self, observation: Observation) -> Command:
        """Return the command that the policy chooses."""
        numbers = self._vector.of(observation)
        seen = numbers[self._places][None, :]
        actions, self._memory = self.policy.act(seen, self._memory)
        if self._is_turned:
            actions = turn_actions(actions, [self._vector.upwind])
        if self._shield is not None:
            actions = [self._shield.shielded(actions[0], numbers)]
        return self._actions.command(observation, actions[0])


class PolicyAgent(Agent):
    """An agent whose policy is a file beside its `program`: its card, or a file with its card beside it."""

    program: ClassVar[str]

    def __init__(self, briefing: Briefing) -> None:
        self.pilot = PolicyRunner(briefing, self.policy_of(briefing))

    def policy_of(self, briefing: Briefing) -> Policy:
        """Return the policy of the file beside the program."""
        load_settings(briefing, self.program)
        return load_policy(Path(self.program).with_name(POLICY_FILE))

    def decide(self, observation: Observation) -> Command:
        """Return the command that the policy chooses."""
        return self.pilot.decide(observation)


class NamedPolicyAgent(PolicyAgent):
    """An agent whose policy is that of the bundled agent, or the file, that its parameter `policy` names."""

    def policy_of(self, briefing: Briefing) -> Policy:
        """Return the policy of the parameter."""
        return find_policy(load_settings(briefing, self.program).policy, Path(self.program).parents[1])


def bundled_policies(agents: Path) -> dict[str, Path]:
    """Return the files of policies that stand beside bundled agents, by the agents' names."""
    return {path.parent.name: path for path in sorted(agents.glob(f"*/{POLICY_FILE}"))}


def find_policy(name: str, agents: Path) -> Policy:
    """Return a policy by the name of a bundled agent, or by its file.

    Args:
        name: The name, or the path of a `.npz` or `.onnx` file.

    Raises:
        PolicyError: there is none, or it cannot be read.
    """
    bundled = bundled_policies(agents)
    if name in bundled:
        return load_policy(bundled[name])
    path = Path(name)
    if not path.is_file():
        raise PolicyError(
            f"parameters.policy: expected one of {', '.join(bundled)}, or the file of a policy, was {name!r}. Give the "
            "whole path; a sandbox sees the files that may_read of the agent names."
        )
    return load_policy(path)
