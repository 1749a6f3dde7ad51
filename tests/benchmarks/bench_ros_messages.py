"""Share of messages of ROS 2 that reach a subscriber in another process.

First a publisher sends as fast as it can, which may be faster than a subscriber reads: its queue then loses messages.
Then a run with a gas sensor and an anemometer flies at a pace, with the bridge between it and the subscriber; its gas
is a formula and its services share a process, so that two cores can fly at 200 times real time. Messages that were lost
are gaps in the numbers that their writers give them.
"""

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from gslcosim.base.ticks import NS_PER_S
from gslcosim_ros.live.messages import QUEUED, make_gas
from gslcosim_ros.node import RosSession
from gslcosim_ros.types import ANEMOMETER, GAS_SENSOR, RosTypes

RATE_HZ = 10
NOSE, WIND = "/beetle/nose", "/beetle/wind"
# Arguments: endpoint, number of messages, then each topic with its type; prints how many came of each topic, and how
# many their writers had sent until the last of these.
SUBSCRIBER = """
import json, queue, sys
from gslcosim_ros import wire
from gslcosim_ros.node import RosSession
from gslcosim_ros.types import RosTypes

endpoint, wanted, topics = sys.argv[1], int(sys.argv[2]), dict(zip(sys.argv[3::2], sys.argv[4::2]))
came, n_came, n_sent = queue.SimpleQueue(), dict.fromkeys(topics, 0), dict.fromkeys(topics, 0)
with RosSession.open(RosTypes("jazzy"), endpoint=endpoint) as session:
    node = session.create_node("listener")
    for topic, kind in topics.items():
        node.subscribe(topic, kind, lambda message: None)
        count = lambda sample, topic=topic: came.put((topic, bytes(sample.attachment)))
        session.zenoh.declare_subscriber(f"0{topic}/**", count)
    sys.stderr.write("ready\\n")
    sys.stderr.flush()
    try:
        while sum(n_came.values()) < wanted:
            topic, attachment = came.get(timeout=30.0)
            n_came[topic] += 1
            n_sent[topic] = max(n_sent[topic], wire.Attachment.from_bytes(attachment).sequence)
    except queue.Empty:
        pass
print(json.dumps({"came": sum(n_came.values()), "sent": sum(n_sent.values())}))
"""


class Subscriber:
    """A process that subscribes to topics and counts."""

    def __init__(self, endpoint: str, n_wanted: int, topics: dict[str, str]) -> None:
        pairs = [word for pair in topics.items() for word in pair]
        command = [sys.executable, "-c", SUBSCRIBER, endpoint, str(n_wanted), *pairs]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def wait_until_ready(self) -> None:
        """Return when it has subscribed."""
        assert self._process.stderr is not None
        assert self._process.stderr.readline() == "ready\n", self._process.stderr.read()

    def count(self) -> dict[str, int]:
        """Wait for its end and return how many messages came, and how many were sent until the last of them."""
        return json.loads(self._process.communicate()[0])


def find_endpoint() -> str:
    """Return an endpoint that is free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def measure_publisher(n_sent: int) -> None:
    """Print the share of messages that are sent as fast as they can be made."""
    endpoint = find_endpoint()
    with RosSession.open(types := RosTypes("jazzy"), endpoint=endpoint) as session:
        publisher = session.create_node("gslcosim").create_publisher(NOSE, GAS_SENSOR, QUEUED)
        subscriber = Subscriber(endpoint, n_sent, {NOSE: GAS_SENSOR})
        session.wait_for("MS", NOSE, timeout_s=60.0)
        subscriber.wait_until_ready()
        began_s = time.perf_counter()
        for i in range(n_sent):
            header = types.header(i * NS_PER_S // RATE_HZ, "beetle/nose")
            publisher.publish(make_gas(types, header, float(i)))
        taken_s = time.perf_counter() - began_s
        n_came = subscriber.count()["came"]
    pace = n_sent / RATE_HZ / taken_s
    sys.stdout.write(
        f"publisher: {n_came} of {n_sent} messages received ({100 * n_came / n_sent:.3f} %), {n_sent / taken_s:.0f} "
        f"messages/s: {pace:.0f} x real time of a sensor at {RATE_HZ} Hz\n"
    )


def measure_run(n_messages: int, pace: float) -> None:
    """Print the share of messages of a run's two sensors."""
    endpoint, limit_s = find_endpoint(), n_messages / 2 / RATE_HZ
    changes = {
        "pace": pace, "ros2.endpoint": endpoint, "referee.stop.time_limit_s": limit_s,
        "referee.success.within_m": 0.001, "agents[0].start": "{python: random_walker}",
        "agents[0].sensors": "[{model: pid, name: nose}, {model: anemometer, name: wind}]",
        "agents[0].vehicle": "{model: holonomic, start_m: [4.5, 2.5, 1], search_height_m: 1}",
        "gas.model": "gaussian_plume",
    }  # fmt: skip
    words = [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
    subscriber = Subscriber(endpoint, n_messages, {NOSE: GAS_SENSOR, WIND: ANEMOMETER})
    subscriber.wait_until_ready()
    with tempfile.TemporaryDirectory() as folder:
        command = [
            Path(sys.executable).with_name("gslcosim"),
            "up",
            "tiny_room",
            "--json",
            "--runs-dir",
            folder,
            *words,
        ]
        result = json.loads(subprocess.run(command, capture_output=True, text=True).stdout)
    counted = subscriber.count()
    sys.stdout.write(
        f"run: {counted['came']} of {counted['sent']} messages received "
        f"({100 * counted['came'] / max(counted['sent'], 1):.3f} %) of {result['ticks']} ticks, "
        f"{result['real_time_factor']:.0f} x real time (asked for {pace:g})\n"
    )


def main() -> None:
    """Print both shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--pace", type=float, default=200.0, help="simulated seconds of the run in a second")
    options = parser.parse_args()
    measure_publisher(options.messages)
    measure_run(options.messages, options.pace)


if __name__ == "__main__":
    main()
