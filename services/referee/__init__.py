"""Referee service: scores agents by the truth and ends the run; `core.RefereeCore` is the participant."""
