"""Keys that this package adds to scenarios: `ros2`, live topics, and `agents[].start.ros2`, a node that decides."""

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, field_validator

from gslcosim.base.problems import broken_rule_error
from gslcosim.base.processes import build_python_command
from gslcosim.base.scenario_keys import AgentStart, ScenarioKey
from gslcosim.base.spec import Spec
from gslcosim_ros.ros_graphs import ROS_ENDPOINT, RosDistribution

if TYPE_CHECKING:
    from gslcosim.scenario.models.scenario import AgentSpec, StartSpec

_ROS_HOSTS = ("tcp/localhost", "tcp/127.0.0.1", "tcp/[::1]")
_LAST_PORT = 65_535
# Stands between a run and a node of ROS 2, as a program of its own.
_AGENT_MODULE = "gslcosim_ros.live.agent"


class RosGraphSpec(Spec):
    """A ROS 2 graph over Zenoh: distribution, domain and router."""

    distro: RosDistribution = Field(
        default="jazzy", description="ROS distribution of the other nodes: hashes of types differ"
    )
    domain: Annotated[int, Field(ge=0, le=232)] = Field(default=0, description="domain, `ROS_DOMAIN_ID` of the nodes")
    endpoint: Annotated[str, Field(pattern=r"^tcp/(localhost|127\.0\.0\.1|\[::1\]):\d{1,5}$")] = Field(
        default=ROS_ENDPOINT,
        description="address of the graph's router on this machine: the run is it, unless one is there already",
    )

    @field_validator("endpoint", mode="before")
    @classmethod
    def _check_endpoint(cls, endpoint: object) -> object:
        if isinstance(endpoint, str):
            host, _, port = endpoint.rpartition(":")
            if host not in _ROS_HOSTS or not (port.isascii() and port.isdigit() and 0 < int(port[:6]) <= _LAST_PORT):
                raise broken_rule_error(
                    expected="an address of this machine with a port from 1 to 65535",
                    found=f"{endpoint[:80]!r}",
                    remedy=f"For example {ROS_ENDPOINT}.",
                )
        return endpoint


class Ros2Spec(RosGraphSpec):
    """Live topics of a run in a ROS 2 graph over Zenoh, without ROS; no influence on results.

    Anyone on this machine can read the graph. Without `truth` it has only what agents are given, and the map.
    """

    truth: bool = Field(default=False, description="publish the ground truth below /truth, and the sources")
    clock_hz: Annotated[float, Field(ge=1, le=10_000)] = Field(
        default=100.0, description="messages on /clock per second of the wall clock, at most"
    )


def _build_command(graph: RosGraphSpec, agent: "AgentSpec") -> list[str]:
    words = [graph.distro, str(graph.domain), graph.endpoint, *(["free"] if agent.is_free else [])]
    return build_python_command("-m", _AGENT_MODULE, *words)


def _check_start(start: "StartSpec") -> None:
    if start.is_behind_gateway:
        raise broken_rule_error(
            key="door",
            expected="none for a node of ROS 2, which has the graph",
            found=start.door,
            remedy="Leave it out.",
        )


def _check_agent(agent: "AgentSpec") -> None:
    if agent.sandbox not in ("auto", "none"):
        raise broken_rule_error(
            key="sandbox",
            expected="none for a node of ROS 2, which needs the network",
            found=agent.sandbox,
            remedy="Leave it out.",
        )


LIVE_TOPICS = ScenarioKey[Ros2Spec | None](
    place="",
    name="ros2",
    annotation=Ros2Spec | None,
    block=Ros2Spec,
    description="live topics in a ROS 2 graph (absent: none); extra ros",
    is_live=True,
)
NODE_START = AgentStart[RosGraphSpec | None](
    name="ros2",
    annotation=RosGraphSpec | None,
    description="the graph of a ROS 2 node that decides, as topics below /AGENT/agent; a program of gslcosim's stands "
    "between; extra ros",
    after="command",
    build_command=_build_command,
    check_start=_check_start,
    check_agent=_check_agent,
    # Its program is this package's, and speaks with the node by TCP.
    is_confinable=False,
)
KEYS = (LIVE_TOPICS, NODE_START)
