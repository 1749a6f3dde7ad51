"""Sandboxes: keep the agents that are started here from everything but their connection to the run.

`choosing` finds the strongest means of this machine, `cells` says what an agent needs to see, `confinement` makes of
both the process to start. That process is `launcher`, which stays beside the agent to watch its limits and to end its
descendants; `landlock` and `seccomp` are what it closes, `bubblewrap` is how the other kind is called.
"""
