"""Columns of the benchmark's tables: names, types and meanings, and the encoding of tracks.

`trials.parquet` has a row for each trial, in the order of the suite. Columns that begin with `wall_`, and
`sandbox`, depend on the machine and its load; all others are the same to the bit wherever, however often and by however
many workers the suite is run. `tracks.parquet` has a row for each agent of each trial, with a value for each second.
"""

import zlib
from dataclasses import dataclass
from typing import Any

import msgpack  # pyright: ignore[reportMissingTypeStubs]
import msgspec
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

WALL = "wall_"
SANDBOX = "sandbox"


@dataclass(frozen=True)
class Column:
    """A column: its type, and what its values are, with unit."""

    name: str
    type: pa.DataType
    meaning: str


_TEXT, _WHOLE, _REAL, _FLAG = pa.string(), pa.int64(), pa.float64(), pa.bool_()

TRIAL_COLUMNS = (
    # Which run.
    Column("trial", _TEXT, "id: a hash of all that decides the flight"),
    Column("case", _TEXT, "the scenario and what was varied, for people: gsl_bench_1/start=3,3"),
    Column("scenario", _TEXT, "name of the scenario"),
    Column("family", _TEXT, "group of cases that are aggregated together: the suite's label of the scenario"),
    Column("varied", _TEXT, "what was varied, as JSON: path to value"),
    Column("repetition", _WHOLE, "from 0 on"),
    Column("entry", _TEXT, "name of the entry"),
    Column("is_control", _FLAG, "whether no source gives off gas: success is luck, a declaration a false alarm"),
    Column("seed", _WHOLE, "seed of the run: equal for all entries of a case and repetition"),
    Column("gas_seed", _WHOLE, "seed of the gas: runs that share it in a room share one plume"),
    Column("knows", _TEXT, "what the entry was granted beside its sensors: map, plume, source, separated by +"),
    Column("sensors", _TEXT, "models of the first agent's sensors, separated by +"),
    Column("n_robots", _WHOLE, "number of agents"),
    Column("environment_hash", _TEXT, "content of the room and its wind"),
    Column("time_limit_s", _REAL, "T: when every run ends [s]"),
    Column("within_m", _REAL, "success radius r_s [m]"),
    Column(
        "success_of", _TEXT, "the success criterion: source, declaration, all_sources, map, or one of another package"
    ),
    Column("start_x_m", _REAL, "start of the first agent, world frame [m]"),
    Column("start_y_m", _REAL, "as above"),
    Column("start_z_m", _REAL, "as above"),
    Column("source_x_m", _REAL, "first source, world frame [m]"),
    Column("source_y_m", _REAL, "as above"),
    Column("source_z_m", _REAL, "as above"),
    # How it ended.
    Column("status", _TEXT, "flown, or why there is no result: crashed, hung, out_of_memory, fault"),
    Column("fault", _TEXT, "what went wrong in the simulation or worker; empty when nothing did"),
    Column("agent_faults", _TEXT, "what the agents did wrong, one sentence each; empty when nothing"),
    Column("digest", _TEXT, "digest of the run; empty when there is none"),
    Column("outcome", _TEXT, "the referee's end reason: success, time_limit, collision, agent_failed, declared, ..."),
    Column("success", _FLAG, "whether an agent succeeded; false where there is no result"),
    Column("time_to_source_s", _REAL, "first success of any agent [s]; absent without one"),
    Column("time_s", _REAL, "min(time to source, T), and T for every failure, collisions too [s]"),
    Column("end_s", _REAL, "simulated time at the end of the run [s]"),
    Column("score", _REAL, "q = S (1 - 0.5 t / T), halved per false declaration, 0 if a collision ended the run"),
    Column("share_arrived", _REAL, "share of the agents that succeeded"),
    # Ways; of the agent that succeeded first, otherwise the one that came nearest.
    Column("steps", _WHOLE, "commands that took effect"),
    Column("path_length_m", _REAL, "length flown [m]"),
    Column("total_path_length_m", _REAL, "length flown by all agents together [m]"),
    Column("shortest_path_m", _REAL, "shortest collision-free way to the success ball [m]; absent without one"),
    Column("travel_overhead", _REAL, "path / shortest - 1; absent without success"),
    Column("spl", _REAL, "S shortest / max(path, shortest), 0 without success"),
    Column("directness", _REAL, "net progress towards the source / path, after first contact; -1 to 1"),
    Column("nearest_m", _REAL, "smallest distance of any agent to a source [m]"),
    Column("time_within_5_m_s", _REAL, "first time within 5 m of a source [s]; absent if never"),
    Column("time_within_2_m_s", _REAL, "as above, 2 m"),
    Column("time_within_1_m_s", _REAL, "as above, 1 m"),
    Column("time_within_05_m_s", _REAL, "as above, 0.5 m"),
    Column("n_collisions", _WHOLE, "collisions of all agents"),
    Column("n_refusals", _WHOLE, "commands that the vehicle refused or changed"),
    # Gas.
    Column("first_contact_s", _REAL, "first true gas above the sensor's floor at a nose of any agent [s]"),
    Column("tracking_ratio", _REAL, "share of the time from first contact to the end in gas above that floor"),
    # Declaration and belief.
    Column("declared", _FLAG, "whether an agent declared a source"),
    Column("first_declared_s", _REAL, "first declaration [s]"),
    Column("declared_confidence", _REAL, "highest confidence of a declaration, 0 to 1; 0 without one"),
    Column("declared_error_m", _REAL, "distance of the first declaration to the nearest source [m]"),
    Column("declared_error_in_plane_m", _REAL, "as above, heights apart [m]"),
    Column("n_false_declarations", _WHOLE, "declarations outside the success radius; on a control all of them"),
    Column("belief_distance_m", _REAL, "expected distance of the last belief to the source = earth mover's [m]"),
    Column("belief_error_m", _REAL, "distance of its mean to the source [m]"),
    Column("belief_mass_near", _REAL, "its probability within the success radius"),
    Column("belief_entropy_bits", _REAL, "its entropy [bit]"),
    Column("belief_minus_log_p", _REAL, "-ln of its probability in the source's cell; absent where that is 0"),
    # The machine's.
    Column("wall_decision_p50_ms", _REAL, "time of a decision, median [ms of wall clock]"),
    Column("wall_decision_p95_ms", _REAL, "time of a decision, 95th percentile [ms of wall clock]"),
    Column("wall_preparing_s", _REAL, "reading the scenario, loading the room [s of wall clock]"),
    Column("wall_starting_s", _REAL, "building cores and starting agents [s of wall clock]"),
    Column("wall_flying_s", _REAL, "flying [s of wall clock]"),
    Column("wall_judging_s", _REAL, "figures of this row [s of wall clock]"),
    Column("wall_storing_s", _REAL, "packing row and track for the file [s of wall clock]"),
    Column("wall_worker", _TEXT, "who flew it"),
    Column(SANDBOX, _TEXT, "what agents were started in: bubblewrap, landlock with its version, none and why"),
)

REQUIRED_COLUMNS = (
    "trial", "case", "scenario", "family", "varied", "repetition", "entry", "is_control", "seed", "gas_seed",
    "n_robots", "environment_hash", "time_limit_s", "status", "outcome", "success", "time_s", "score",
)  # fmt: skip
"""Those that have a value in each row, of trials without a result too."""

_SERIES = pa.list_(pa.float32())

TRACK_COLUMNS = (
    Column("trial", _TEXT, "id of the trial"),
    Column("agent", _TEXT, "name of the agent"),
    Column("t_s", _SERIES, "simulated time, about one a second and the last [s]"),
    Column("x_m", _SERIES, "true position, world frame [m]"),
    Column("y_m", _SERIES, "as above"),
    Column("z_m", _SERIES, "as above"),
    Column("distance_m", _SERIES, "distance to the nearest source [m]"),
    Column("gas_ppm", _SERIES, "true mixing ratio at the first nose [ppm]"),
    Column("reading", _SERIES, "what its first gas sensor reported, in the sensor's unit"),
    Column("belief_distance_m", _SERIES, "expected distance of the belief to the source [m]; NaN without one"),
    Column("belief_mass_near", _SERIES, "probability of the belief within the success radius; NaN without one"),
)

TRIALS = pa.schema([(column.name, column.type) for column in TRIAL_COLUMNS])
TRACKS = pa.schema([(column.name, column.type) for column in TRACK_COLUMNS])


def is_machine_dependent(column: str) -> bool:
    """Return whether a column's values depend on the machine and its load."""
    return column.startswith(WALL) or column == SANDBOX


Tracks = dict[str, dict[str, NDArray[np.float32]]]
"""For each agent its series by the names of `TRACK_COLUMNS`, all of one length."""

SERIES = tuple(column.name for column in TRACK_COLUMNS if column.name not in ("trial", "agent"))
_msgpack: Any = msgpack


def pack_tracks(tracks: Tracks) -> bytes:
    """Return tracks as compressed bytes."""
    agents = {name: [series[key].astype("<f4").tobytes() for key in SERIES] for name, series in tracks.items()}
    return zlib.compress(_msgpack.packb(agents, use_bin_type=True), level=6)


def unpack_tracks(payload: bytes) -> Tracks:
    """Return the tracks that `pack_tracks` has made bytes of.

    Raises:
        ValueError: the bytes are something else.
        zlib.error: they are not compressed.
    """
    try:
        agents = msgspec.msgpack.decode(zlib.decompress(payload), type=dict[str, list[bytes]])
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return {
        name: {key: np.frombuffer(part, dtype="<f4") for key, part in zip(SERIES, parts, strict=True)}
        for name, parts in agents.items()
    }
