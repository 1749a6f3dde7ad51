"""Processes of a run: started, forked, sandboxed, watched and ended."""
