"""The runtime's side of agents: how they are started, their links, their doors, and what they owe."""
