"""A run as independent processes over a bus: the supervisor, the host of each service, and what they tell each other.

From outside: `launch.fly_over_bus` flies a scenario so, `service.main` is the life of a service's process.
"""
