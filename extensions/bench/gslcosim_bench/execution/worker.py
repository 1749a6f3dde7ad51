"""Work of a worker process of a pool: one job after the other."""

import time
import traceback
from multiprocessing.connection import Connection

from gslcosim.base.errors import GslCosimError
from gslcosim_bench.cases.plan import reference_loop_s
from gslcosim_bench.execution.pool import Job
from gslcosim_bench.execution.trial import EnvironmentCache

# One run in so many is preceded by the loop that says how fast the machine is.
REFERENCE_EVERY = 25


def do_jobs(connection: "Connection[object, object]") -> None:
    """Do the jobs that come over a connection, until it is closed."""
    rooms = EnvironmentCache()
    n_flown = 0
    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        assert isinstance(job, Job)
        connection.send(("started", job.key, None))
        n_flown += job.kind == "fly"
        if n_flown % REFERENCE_EVERY == 1:
            connection.send(("reference", job.key, reference_loop_s()))
        began = time.perf_counter()
        kind, result = _done(job, rooms, connection)
        connection.send((kind, job.key, (result, time.perf_counter() - began)))


def _done(job: Job, rooms: EnvironmentCache, connection: "Connection[object, object]") -> tuple[str, object]:
    try:
        return "done", job.do(rooms, lambda text, fraction: connection.send(("progress", job.key, (text, fraction))))
    except MemoryError:
        return "failed", ("out_of_memory", "the worker had no more memory")
    except GslCosimError as error:
        return "failed", ("fault", str(error))
    except Exception:  # told with its trace; the worker goes on
        return "failed", ("fault", traceback.format_exc())
