"""Agents in a run: sessions, validation of commands, transports, and the loading of their programs.

`session.AgentSession` stands for one agent in a run: `validator` decides which of its commands count, and a transport
carries the messages: to an object in this process (`session.ObjectTransport`), to a process on the bus
(`bus_transport`), or to a process behind the gateway (`gateway_transport`).
"""
