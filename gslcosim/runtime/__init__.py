"""Runtime: hosts cores in one process or behind a bus, and supervises; the only code that waits or reads a clock.

For `gslcosim join` there are `remote_join.join_as_services` and `join_as_agent`; `remote_server.RunServer` is the
side of the host that runs the others.
"""
