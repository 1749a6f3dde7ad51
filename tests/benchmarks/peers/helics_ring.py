"""Five HELICS federates in processes of their own, with a broker in this one; prints ticks per second as JSON.

    .venv-peers/bin/python tests/benchmarks/peers/helics_ring.py --core zmq --shape closed --ticks 2000

Within a tick each federate stands one second after the one it reads, by HELICS's own offset in time: a value arrives
only at a later time than it was sent, and so it does within the same tick.
"""

import argparse
import json
import socket
import sys
import tempfile
from pathlib import Path

import helics as h
from ring import NAMES, SHAPES, Participant, places, run_processes, ticks_per_s

TICK_S = len(NAMES)
# What the agent says at the last tick finds nobody any more, which is not worth a warning.
QUIET = "--loglevel=error"


def broker_port() -> int:
    """Return a port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def address(core: str, folder: Path) -> tuple[str, str]:
    """Return what the broker and what a core are given about where the broker is."""
    if core == "ipc":
        name = f"broker_{folder.name}"
        return f"--local_interface={name}", f"--broker_address={name}"
    port = broker_port()
    return f"--local_interface=127.0.0.1 --localport={port}", f"--broker_address=127.0.0.1 --brokerport={port}"


def participate(options: argparse.Namespace) -> None:
    """Take part as one federate."""
    place = places(options.shape)[NAMES.index(options.name)]
    participant = Participant(place)
    info = h.helicsCreateFederateInfo()
    h.helicsFederateInfoSetCoreTypeFromString(info, options.core)
    h.helicsFederateInfoSetCoreInitString(info, f"--federates=1 {QUIET} {options.address}")
    h.helicsFederateInfoSetTimeProperty(info, h.HELICS_PROPERTY_TIME_PERIOD, TICK_S)
    h.helicsFederateInfoSetTimeProperty(info, h.HELICS_PROPERTY_TIME_OFFSET, place.index)
    h.helicsFederateInfoSetFlagOption(info, h.HELICS_FLAG_UNINTERRUPTIBLE, True)
    federate = h.helicsCreateValueFederate(place.name, info)
    said = h.helicsFederateRegisterGlobalPublication(federate, place.name, h.HELICS_DATA_TYPE_STRING, "")
    received = h.helicsFederateRegisterSubscription(federate, place.reads, "") if place.reads else None
    h.helicsFederateEnterExecutingMode(federate)
    for tick in range(options.ticks):
        h.helicsFederateRequestTime(federate, (tick + 1) * TICK_S + place.index)
        text = h.helicsInputGetString(received) if received and tick >= place.delay_ticks else ""
        h.helicsPublicationPublishString(said, participant.step(tick, text))
    participant.save_times(options.folder)
    h.helicsFederateDisconnect(federate)
    h.helicsFederateFree(federate)
    h.helicsCloseLibrary()


def measure(options: argparse.Namespace) -> dict[str, float]:
    """Run all five and return their speed."""
    with tempfile.TemporaryDirectory(prefix="peers-") as temporary:
        folder = Path(temporary)
        of_broker, of_core = address(options.core, folder)
        broker = h.helicsCreateBroker(options.core, "", f"--federates={len(NAMES)} {QUIET} {of_broker}")
        own = [sys.executable, __file__, *sys.argv[1:], "--folder", temporary, f"--address={of_core}"]
        run_processes([[*own, "--name", name] for name in NAMES])
        h.helicsBrokerDisconnect(broker)
        h.helicsCloseLibrary()
        return {"ticks_per_s": ticks_per_s(folder, options.ticks)}


def main() -> None:
    """Print the speed, or be one of the five."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--core", choices=("zmq", "tcp", "ipc"), required=True, help="how federates reach each other")
    parser.add_argument("--shape", choices=SHAPES, required=True, help="see ring.py")
    parser.add_argument("--ticks", type=int, default=2000, help="how many")
    parser.add_argument("--name", choices=NAMES, help="be this participant")
    parser.add_argument("--folder", type=Path, help="of a participant: where its times go")
    parser.add_argument("--address", help="of a participant: where the broker is")
    options = parser.parse_args()
    if options.name:
        participate(options)
    else:
        print(json.dumps(measure(options)))  # noqa: T201


if __name__ == "__main__":
    main()
