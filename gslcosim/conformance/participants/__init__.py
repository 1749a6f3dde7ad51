"""Conformance check of participants: scripted sessions with a program, and one rule a line."""

from gslcosim.conformance.participants.check import check_participant
from gslcosim.conformance.rules import PARTICIPANT_RULES

__all__ = ["PARTICIPANT_RULES", "check_participant"]
