"""Criteria of success: each judges one agent by the evidence of every tick; `criterion_of` finds it by its block."""

# For its registrations.
from gslcosim.referee.success import judges as judges
from gslcosim.referee.success.criterion import Criterion, Evidence, criterion_of

__all__ = ["Criterion", "Evidence", "criterion_of"]
