"""Proves an agent right: a scripted peer plays whole sessions with it, and each rule of the contract is judged."""

from gslcosim.conformance.checking import Check, check_agent
from gslcosim.conformance.findings import CheckReport, Finding, Status
from gslcosim.conformance.flight import FlightLimits
from gslcosim.conformance.rules import RULES, Rule
from gslcosim.conformance.wiring import Wiring

__all__ = ["RULES", "Check", "CheckReport", "Finding", "FlightLimits", "Rule", "Status", "Wiring", "check_agent"]
