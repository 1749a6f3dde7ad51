"""Sandboxes: restrict the agents that are started here to their connection to the run.

`selection` finds the strongest sandbox of this machine and builds the confinement of a process; `policy` lists the
files and sockets that the process may use. `launcher` is the process that is started: it stays beside the agent, checks
the agent's limits and ends its descendants. `bubblewrap` confines the agent where it works, otherwise `confinement`.
"""
