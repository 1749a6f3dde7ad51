"""A run on several hosts: what its own host offers to others, and how another host takes part in it.

From outside: `taking_part.serve_from_here` and `agents_from_here.fly_agent_from_here` are the two lives of
`gslcosim join`; `offering.Offering` is the side of the host that flies the run.
"""
