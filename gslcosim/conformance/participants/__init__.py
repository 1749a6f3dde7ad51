"""The tests that we ship to authors of participants: scripted sessions with a program, and a rule a line."""

from gslcosim.conformance.participants.examination import check_participant
from gslcosim.conformance.participants.participant_rules import PARTICIPANT_RULES

__all__ = ["PARTICIPANT_RULES", "check_participant"]
