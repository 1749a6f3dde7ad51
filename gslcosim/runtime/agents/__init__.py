"""Agents in a run: sessions, validation of commands, transports, and the loading of their programs.

`desk.Desk` is the place of one agent in a run. It speaks to the agent over a link (`links.AgentLink`), of which there
are three kinds: to an object in this process, to a process on the bus, and to a process behind the gateway.
"""
