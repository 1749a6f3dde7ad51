"""Accounts of a run's router, and what each may do."""

from dataclasses import dataclass
from typing import Any

SERVICE_USER = "service"


@dataclass(frozen=True, kw_only=True)
class AgentUser:
    """The account of a process that flies an agent: the agent's keys, and those of `others` if there are, are all it
    can reach.
    """

    agent: str
    password: str
    others: tuple[str, ...] = ()

    @property
    def user(self) -> str:
        """The account's name."""
        return f"agent_{self.agent}"


# Rules match when the rule's key includes the message's key, so an agent may subscribe to `**` and still sees only
# what its egress rule lets through.
def access_control(namespace: str, agents: list[AgentUser]) -> dict[str, Any]:
    """Return what Zenoh's router is told: services may do everything, agents what `AgentUser` says."""
    rules: list[dict[str, Any]] = [
        {
            "id": "everything",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": [
                "put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
                "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
            ],
            "key_exprs": ["**"],
        }
    ]  # fmt: skip
    subjects: list[dict[str, Any]] = [{"id": SERVICE_USER, "usernames": [SERVICE_USER]}]
    policies: list[dict[str, Any]] = [{"rules": ["everything"], "subjects": [SERVICE_USER]}]
    for agent in agents:
        homes = [f"{namespace}/agents/{name}" for name in (agent.agent, *agent.others)]
        everything = [f"{home}/**" for home in homes]
        commands, tokens = [f"{home}/command" for home in homes], [f"{home}/alive" for home in homes]
        mine = [
            _rule(f"{agent.user}_hears", "egress", ["put", "delete", "reply"], everything),
            _rule(f"{agent.user}_asks", "ingress", ["declare_subscriber", "query"], ["**"]),
            _rule(f"{agent.user}_is_asked", "egress", ["declare_subscriber"], commands),
            _rule(f"{agent.user}_acts", "ingress", ["put"], commands),
            _rule(f"{agent.user}_lives", "ingress", ["liveliness_token"], tokens),
        ]
        rules += mine
        subjects.append({"id": agent.user, "usernames": [agent.user]})
        policies.append({"rules": [rule["id"] for rule in mine], "subjects": [agent.user]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(rule_id: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": rule_id, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
