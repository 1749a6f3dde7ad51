"""Runs on several hosts: the server on the run's own host, and how another host joins with services or an agent.

`service_join.join_as_services` and `agent_join.join_as_agent` are the two forms of `gslcosim join`;
`run_server.RunServer` is the side of the run's own host.
"""
