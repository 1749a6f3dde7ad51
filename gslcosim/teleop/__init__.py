"""Teleoperation: a person in place of an agent, who sees its observations on a terminal and commands with keys."""
