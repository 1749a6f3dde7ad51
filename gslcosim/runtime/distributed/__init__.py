"""Runs as independent processes over a bus: supervisor, hosts of services, and their protocol.

`process_launch.run_distributed` runs a scenario so; `service_main.main` is the program of a service's process.
"""
