"""Logs of real robots as runs, scored by our referee and recorded with our views."""
