"""The agent that flies a learned policy."""

from abc import abstractmethod
from pathlib import Path

import numpy as np

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.search.learned.acting import action_kind
from gslcosim.search.learned.observing import ObservationVector
from gslcosim.search.learned.policies.fitting import places_of
from gslcosim.search.learned.policies.policy import Policy, PolicyError
from gslcosim.search.learned.policies.policy_files import load_policy
from gslcosim.search.method import settings_of

# The file of a policy that is an agent of its own, beside its program.
POLICY_FILE = "policy.npz"


class PolicyPilot:
    """Turns what an agent is told into what a policy observes, and what it chooses into commands.

    Args:
        briefing: Of the agent.
        policy: What decides.

    Raises:
        PolicyError: the agent lacks something that the policy observes.
    """

    def __init__(self, briefing: Briefing, policy: Policy) -> None:
        self.policy = policy
        self._vector = ObservationVector(briefing)
        self._places = np.array(places_of(policy, self._vector.names))
        settings = policy.action
        self._actions = action_kind(
            settings.kind, briefing, step_m=settings.step_m, speed_m_s=settings.speed_m_s, hold_s=settings.hold_s
        )
        self._memory = policy.memory(1)

    def decide(self, observation: Observation) -> Command:
        """Return the command that the policy chooses."""
        seen = self._vector.of(observation)[self._places][None, :]
        actions, self._memory = self.policy.act(seen, self._memory)
        return self._actions.command(observation, actions[0])


class PolicyAgent(Agent):
    """An agent whose policy is a file."""

    def __init__(self, briefing: Briefing) -> None:
        self.pilot = PolicyPilot(briefing, self.policy_of(briefing))

    @abstractmethod
    def policy_of(self, briefing: Briefing) -> Policy:
        """Return the policy that is to be flown."""

    def decide(self, observation: Observation) -> Command:
        """Return the command that the policy chooses."""
        return self.pilot.decide(observation)


def policy_beside(briefing: Briefing, program: str) -> Policy:
    """Return the policy of the file beside a bundled agent's program.

    Args:
        briefing: What the agent is told.
        program: The agent's file (`__file__`), with its card beside it.

    Raises:
        MethodError: the agent lacks something that its card asks for, or a parameter is wrong.
        PolicyError: the file cannot be read.
    """
    settings_of(briefing, program)
    return load_policy(Path(program).with_name(POLICY_FILE))


def bundled_policies(agents: Path) -> dict[str, Path]:
    """Return the files of policies that stand beside bundled agents, by the agents' names.

    Args:
        agents: The folder of the agents.
    """
    return {path.parent.name: path for path in sorted(agents.glob(f"*/{POLICY_FILE}"))}


def named_policy(name: str, agents: Path) -> Policy:
    """Return a policy by the name of a bundled agent, or by its file.

    Args:
        name: The name, or the path of a `.npz` or `.onnx` file.
        agents: The folder of the agents.

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
            "whole path; a sandbox sees the folders that may_read of the agent names."
        )
    return load_policy(path)
