"""The runtime's side of agents: how they are started, their links, their doors, and what they owe.

`desk.Desk` is the place of one agent in a run. It speaks to the agent over a link (`links.AgentLink`), of which there
are three kinds: to an object in this process, to a process on the bus, and to a process behind the gateway.
"""
