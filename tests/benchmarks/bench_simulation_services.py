"""Time of one call of GADEN's services and of one step by a service, over Zenoh, until its bytes are at the client."""

import argparse
import socket
import sys
import time

import numpy as np

from gslcosim.simulation.simulation import Simulation
from gslcosim_ros import simulation_interfaces as interfaces
from gslcosim_ros import wire
from gslcosim_ros.node import RosSession
from gslcosim_ros.simulation_services import SimulationServices
from gslcosim_ros.types import RosTypes


def main() -> None:
    """Print the medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="tiny_room")
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--calls", type=int, default=20)
    arguments = parser.parse_args()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    types = RosTypes("jazzy")
    interfaces.define_interfaces(types)
    with (
        RosSession.open(RosTypes("jazzy"), endpoint=endpoint) as session,
        Simulation(arguments.scenario) as simulation,
        RosSession.open(types, endpoint=endpoint) as other,
    ):
        services = SimulationServices(simulation, session)
        simulation.step(20)
        grid = simulation.environment.grid
        points_m = np.random.default_rng(1).uniform(grid.origin_m, grid.max_m, (arguments.points, 3))
        columns = dict(zip("xyz", np.ascontiguousarray(points_m.T), strict=True))
        step = interfaces.get_service_type("StepSimulation")
        requests = (
            ("/odor_value", interfaces.GADEN_GAS, columns),
            ("/wind_value", interfaces.GADEN_WIND, columns),
            ("/gslcosim/step_simulation", step, {"steps": 1}),
        )
        for name, kind, fields in requests:
            other.wait_for("SS", name)
            key, request = wire.build_key(0, name, kind, types.hash(kind)), types.make(f"{kind}_Request", **fields)
            payload, attachment = types.to_cdr(request), wire.Attachment.now(1, bytes(16)).to_bytes()
            taken_s: list[float] = []
            for _ in range(arguments.calls + 1):
                began_s = time.perf_counter()
                # The first call may compile kernels.
                (reply,) = other.zenoh.get(key, payload=payload, attachment=attachment, timeout=120.0)
                taken_s.append(time.perf_counter() - began_s)
                assert reply.ok is not None
            median_s, least_s = np.median(taken_s[1:]), min(taken_s[1:])
            sys.stdout.write(f"{name}: median {1e3 * median_s:.2f} ms, least {1e3 * least_s:.2f} ms a call\n")
        began_s = time.perf_counter()
        ppm = np.stack([simulation.truth.gas_ppm(points_m, gas) for gas in simulation.truth.gases])
        sys.stdout.write(f"gas alone: {1e3 * (time.perf_counter() - began_s):.2f} ms for {ppm.size} numbers\n")
        services.wait_until_quit(0.0)


if __name__ == "__main__":
    main()
