"""Conformance check of agents: a scripted peer plays whole sessions with one, and judges each rule of the contract."""

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
