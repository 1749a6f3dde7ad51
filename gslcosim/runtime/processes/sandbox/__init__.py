"""Sandboxes: keep the agents that are started here from everything but their connection to the run.

`selection` finds the strongest sandbox of this machine and builds the confinement of a process, `policy` says which
files and sockets it may use. `launcher` is the process that is started: it stays beside the agent to watch its limits
and to end its descendants; `confinement` confines it, or `bubblewrap` where that works.
"""
