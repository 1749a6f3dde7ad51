"""Runs on several hosts: the server on the run's own host, and how another host joins with services or an agent.

From outside: `taking_part.serve_from_here` and `agents_from_here.fly_agent_from_here` are the two lives of
`gslcosim join`; `offering.Offering` is the side of the host that flies the run.
"""
