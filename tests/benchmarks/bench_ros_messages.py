"""Share of messages of ROS 2 that reach a subscriber in another process, sent as fast as they can be made."""

import argparse
import socket
import subprocess
import sys
import time

from gslcosim.base.ticks import NS_PER_S
from gslcosim.ros.node import RosSession
from gslcosim.ros.types import GAS_SENSOR, RosTypes
from gslcosim_services.ros2.core import QUEUED
from gslcosim_services.ros2.messages import make_gas

TOPIC, RATE_HZ = "/beetle/nose", 20
SUBSCRIBER = """
import queue, sys
from gslcosim.ros.node import RosSession
from gslcosim.ros.types import GAS_SENSOR, RosTypes

readings, n, wanted = queue.SimpleQueue(), 0, int(sys.argv[2])
with RosSession.open(RosTypes("jazzy"), endpoint=sys.argv[1]) as session:
    session.create_node("listener").subscribe(sys.argv[3], GAS_SENSOR, readings.put)
    try:
        while n < wanted:
            readings.get(timeout=10.0)
            n += 1
    except queue.Empty:
        pass
print(n)
"""


def main() -> None:
    """Print the share, and how much faster than real time a run with one such sensor would be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=100_000)
    n_sent = parser.parse_args().messages
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with RosSession.open(types := RosTypes("jazzy"), endpoint=endpoint) as session:
        publisher = session.create_node("gslcosim").create_publisher(TOPIC, GAS_SENSOR, QUEUED)
        command = [sys.executable, "-c", SUBSCRIBER, endpoint, str(n_sent), TOPIC]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as subscriber:
            session.wait_for("MS", TOPIC, timeout_s=60.0)
            began_s = time.perf_counter()
            for i in range(n_sent):
                header = types.header(i * NS_PER_S // RATE_HZ, "beetle/nose")
                publisher.publish(make_gas(types, header, float(i)))
            taken_s = time.perf_counter() - began_s
            n_received = int(subscriber.communicate()[0])
    pace = n_sent / RATE_HZ / taken_s
    sys.stdout.write(
        f"{n_received} of {n_sent} messages received ({100 * n_received / n_sent:.3f} %), {n_sent / taken_s:.0f} "
        f"messages/s: {pace:.0f} x real time of a sensor at {RATE_HZ} Hz\n"
    )


if __name__ == "__main__":
    main()
