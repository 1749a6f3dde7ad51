"""Conformance check of agents: a scripted peer plays whole sessions with one, and judges each rule of the contract."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gslcosim_conformance.agent_check import AgentCheck, check_agent
    from gslcosim_conformance.rules import RULES, CheckReport, Finding, Rule, Status
    from gslcosim_conformance.transcript import SessionLimits
    from gslcosim_conformance.transports import ConnectionSpec

__all__ = [
    "RULES",
    "AgentCheck",
    "CheckReport",
    "ConnectionSpec",
    "Finding",
    "Rule",
    "SessionLimits",
    "Status",
    "check_agent",
]
_HOMES = {
    "AgentCheck": "agent_check",
    "check_agent": "agent_check",
    "SessionLimits": "transcript",
    "ConnectionSpec": "transports",
}


# The commands of this package are listed at each start of `gslcosim`, most of which check nothing.
def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(import_module(f"{__name__}.{_HOMES.get(name, 'rules')}"), name)
