"""The gateway: agents that speak length-prefixed msgpack or JSON lines over pipes and sockets, without a bus."""
