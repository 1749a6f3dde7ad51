"""Threads that meet a message type for the first time together all decode it."""

import subprocess
import sys

from contract_examples import EXAMPLES

from gslcosim.contract import codec

# In a process of its own, which a mistake ends. Threads change places as often as they can; each type is new.
PROGRAM = """
import sys, threading
from gslcosim.contract import codec
from gslcosim.contract.messages import Observation

payload, n_threads, decoded = bytes.fromhex(sys.argv[1]), 6, []
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
print(len(decoded), all(message.tick == int(sys.argv[2]) for message in decoded))
"""


def test_a_type_that_threads_meet_together_is_decoded_by_all():
    example = EXAMPLES["observation"]
    command = [sys.executable, "-c", PROGRAM, codec.encode(example).hex(), str(example.tick)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (0, "600 True\n"), ran.stderr
