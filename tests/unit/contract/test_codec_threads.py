"""Threads that meet a message type for the first time together all decode it."""

import subprocess
import sys

# In a process of its own, which a mistake ends. Threads change places as often as they can; each type is new.
PROGRAM = """
import sys, threading
from gslcosim.contract import codec
from gslcosim.contract.messages import Observation
from gslcosim.contract.publish.examples import EXAMPLES

example = next(message for message in EXAMPLES.values() if type(message) is Observation)
payload, n_threads, decoded = codec.encode(example), 6, []
sys.setswitchinterval(1e-6)

def decode(kind, barrier):
    barrier.wait()
    decoded.append(codec.decode_trusted(kind, payload))

for i in range(100):
    kind = type(f"Observation{i}", (Observation,), {"__module__": Observation.__module__})
    barrier = threading.Barrier(n_threads)
    threads = [threading.Thread(target=decode, args=(kind, barrier)) for _ in range(n_threads)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
print(len(decoded), all(message.tick == example.tick for message in decoded))
"""


def test_a_type_that_threads_meet_together_is_decoded_by_all():
    ran = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (0, "600 True\n"), ran.stderr
