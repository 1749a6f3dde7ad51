"""Flights of real robots as runs: their logs, judged by our referee and recorded with our views."""
