"""Runs as independent processes over a bus: supervisor, hosts of services, and their protocol.

From outside: `launch.fly_over_bus` flies a scenario so, `service.main` is the life of a service's process.
"""
