"""Records and arrays that the batch kernels work on: environments, cases, instruments, and each search's state."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gslcosim.vehicles.catalogue import MAX_ROTORS

# Where arrays of different shapes are given by their address, the Python side keeps them alive.
ROOM = np.dtype(
    [
        ("origin_m", np.float64, (3,)),
        ("max_m", np.float64, (3,)),
        ("cell_m", np.float64),
        ("shape", np.int64, (3,)),
        ("occupancy", np.int64),  # address of (nx, ny, nz) uint8
        ("wind", np.int64),  # address of (t, nx, ny, nz, 3) float32
        ("wind_shape", np.int64, (4,)),
        ("wind_period_s", np.float64),
        ("wind_loops", np.int64),
        ("boxes_m", np.int64),  # address of (n, 6) float64: least and greatest corner of each solid box
        ("n_boxes", np.int64),
        ("near_origin_m", np.float64, (3,)),  # blocks of space, and which boxes a vehicle in them may touch
        ("near_block_m", np.float64),
        ("near_shape", np.int64, (3,)),
        ("near_first", np.int64),  # address of (n_blocks + 1,) int32
        ("near_members", np.int64),  # address of int32
        ("solid_sums", np.int64),  # address of (nx + 1, ny + 1, nz + 1) int32, see `build_solid_sums`
        ("ray_boxes_m", np.int64),  # what rays meet, see `RayScene`: address of (n, 6) float64
        ("n_ray_boxes", np.int64),
        ("ray_first", np.int64),  # address of (n_bins + 1,) int64
        ("ray_members", np.int64),  # address of int64
        ("ray_origin_m", np.float64, (3,)),
        ("ray_bin_m", np.float64),
        ("ray_shape", np.int64, (3,)),
    ]
)

STEADY_PLUMES, FILAMENTS, MEANDERING_PLUMES, FRAMES = range(4)
# What the referee asks for.
NEAREST_SOURCE, ALL_SOURCES = 0, 1

# How a vehicle flies: as a mass that its force moves, as one whose force lags, or with attitude and rotors.
POINT, LAGGED, RIGID_BODY = range(3)
# Numbers of a row of `Cases.start_rows`: place, velocity, whether something forbidden and whether anything is touched;
# and of a rigid body its quaternion, its rates, its rotors' speeds, and what its control has learned of steady forces.
START_TOUCHES, START_QUATERNION, START_RATES, START_ROTORS = 6, 8, 12, 15
START_INTEGRAL = START_ROTORS + MAX_ROTORS
N_START_NUMBERS = START_INTEGRAL + 3

CASE = np.dtype(
    [
        ("room", np.int64),
        ("tick_ns", np.int64),
        ("tick_s", np.float64),
        ("n_substeps", np.int64),
        ("physics_step_s", np.float64),
        ("radius_m", np.float64),
        ("dynamics", np.int64),  # POINT, or LAGGED, for which the next four are, or RIGID_BODY
        ("half_height_m", np.float64),
        ("tilt_share", np.float64),  # of what is wanted sideways and upwards, given in a physics step
        ("lift_share", np.float64),
        ("rotor_speeds_rad_s", np.float64),  # sum of all in hover
        ("hull_half_m", np.float64, (3,)),  # of a rigid body: half sizes of a box around its parts, body frame
        ("max_speed_m_s", np.float64),
        ("max_acceleration_m_s2", np.float64),
        ("start_m", np.float64, (3,)),  # where the vehicle rests at tick 0
        ("search_height_m", np.float64),
        ("usual_hold_ticks", np.int64),
        ("asks_every_tick", np.int64),
        ("hold_ticks", np.int64),  # of the actions
        ("first_start_row", np.int64),  # how the vehicle leaves what it stands on, tick by tick
        ("n_start_rows", np.int64),
        ("first_source", np.int64),
        ("n_sources", np.int64),
        ("criterion", np.int64),
        ("within_m", np.float64),
        ("is_horizontal", np.int64),
        ("time_limit_s", np.float64),
        ("ends_on_collision", np.int64),
        ("first_distance_m", np.float64),  # of the start as the scenario has it
        ("first_place_m", np.float64, (3,)),  # that start
        ("diagonal_m", np.float64),
        ("n_sampled", np.int64),  # how many places are sampled for gas and wind, the first ones
        ("gas", np.int64),  # STEADY_PLUMES, FILAMENTS, MEANDERING_PLUMES or FRAMES
        ("first_plume", np.int64),  # of the plumes, or of the sources of filaments
        ("n_plumes", np.int64),
        ("tape", np.int64),
        ("cutoff_sigma", np.float64),
        ("n_gases", np.int64),
        ("gas_ticks_per_step", np.int64),
        ("first_update", np.int64),  # of frames, see `Cases.frame_of_update`
        ("n_updates", np.int64),
        ("gas_steps_per_tick", np.int64),  # what follows is for meandering plumes, see `gas_readings`
        ("gas_step_s", np.float64),
        ("warm_up_steps", np.int64),
        ("gas_seed", np.int64),  # -1: the search's
        ("first_wander_name", np.int64),  # of the random streams of their paths, which are equally long
        ("n_wander_name", np.int64),
        ("first_knot", np.int64),  # where knots are kept among the numbers of a search, a ring for each path
        ("n_knots", np.int64),
        ("knot_s", np.float64),
        ("wander_rho", np.float64),
        ("instantaneous_frac", np.float64),
        ("warm_up_s", np.float64),
        ("centre_m", np.float64, (3,)),  # for the numbers of an observation
        ("half_m", np.float64, (3,)),
        ("least_m", np.float64, (3,)),  # between these the agent sends its vehicle
        ("most_m", np.float64, (3,)),
    ]
)

# A tape of filaments, and in which columns of space each frame's are.
TAPE = np.dtype(
    [
        ("n_frames", np.int64),
        ("first", np.int64),  # address of (n_frames + 1,) int64
        ("sorted_numbers", np.int64),  # address of (4, n) float32: x, y, z and sigma, by columns
        ("n_rows", np.int64),
        ("sources", np.int64),  # address of (n,) uint8; 0: there is one
        ("origin_m", np.float64, (2,)),
        ("column_m", np.float64),
        ("shape", np.int64, (2,)),
        ("starts", np.int64),  # address of (n_frames, n_columns + 1) int32
        ("members", np.int64),  # address of (n,) int32: which of the frame's filaments they are, in order by column
        ("largest_sigma_m", np.int64),  # address of (n_frames,) float32
    ]
)

# A frame of gas that is known beforehand: a grid, or filaments in the order of `spatial_index`.
FRAME = np.dtype(
    [
        ("ppm", np.int64),  # address of (nx, ny, nz) float32; 0: filaments
        ("shape", np.int64, (3,)),
        ("origin_m", np.float64, (3,)),
        ("cell_m", np.float64),
        ("is_plane", np.int64),
        ("n_gases", np.int64),  # which are released, the first ones of the case's
        ("n_filaments", np.int64),
        ("x", np.int64),  # addresses of the columns of `SortedFilaments`, (n_filaments,) each
        ("y", np.int64),
        ("z", np.int64),
        ("exponent_per_m2", np.int64),
        ("centre_ppm", np.int64),
        ("gas", np.int64),
        ("first", np.int64),  # and of the arrays of `Blocks`
        ("largest_sigma_m", np.int64),
        ("n_blocks", np.int64, (3,)),
        ("block_m", np.float64),
        ("block_origin_m", np.float64, (3,)),
        ("largest_of_all_m", np.float64),
    ]
)

# What a sensor looks at: gas and wind, by a kernel of its own, or what is around it.
KERNEL, RANGES, BUMP = range(3)
MOST_GASES, MOST_VALUES, MOST_NUMBERS = 8, 4, 16
# Gas, wind and velocity of a sample that is seen later.
SAMPLE_LENGTH = MOST_GASES + 6

INSTRUMENT = np.dtype(
    [
        ("kind", np.int64),
        ("place", np.int64),  # which of the places that are sampled
        ("advance", np.int64),  # addresses of its kernels, see `scalar_compilation`: of `SensorKernel.advance`
        ("estimate", np.int64),  # of `KernelEstimator.estimate`; 0: there is none
        ("encode", np.int64),  # of how its values become numbers of an observation, and its estimate; 0: they do not
        ("encode_estimate", np.int64),
        (
            "parameters",
            np.int64,
        ),  # addresses of float64: of its kernel, a new one's state, and its estimate
        ("n_parameters", np.int64),
        ("new_state", np.int64),
        ("n_state", np.int64),
        ("estimate_parameters", np.int64),
        ("n_estimate_parameters", np.int64),
        ("n_values", np.int64),
        ("first_number", np.int64),  # where they stand in an observation
        ("n_numbers", np.int64),
        ("estimate_number", np.int64),
        ("first_name", np.int64),  # of its random stream
        ("n_name", np.int64),
        ("has_errors", np.int64),  # whether what follows counts
        ("n_with_errors", np.int64),
        ("noise_std", np.float64),
        ("bias", np.float64),
        ("drift_per_s", np.float64),
        ("gain_spread", np.float64),  # how units differ
        ("drift_spread_per_s", np.float64),
        ("resolution", np.float64),
        ("max_value", np.float64),
        ("least_value", np.float64),
        ("period_ticks", np.int64),
        ("warm_up_ticks", np.int64),
        ("first_memory", np.int64),  # where its state is kept, and then its samples of late
        ("delay_ticks", np.int64),
        ("own_noise", np.float64),  # what follows is for ranges
        ("max_range_m", np.float64),
        ("directions", np.int64),  # address of (n_rays, 3) float64, body frame
        ("n_rays", np.int64),
        ("n_azimuths", np.int64),  # of a lidar, whose rays are in order of elevations; 0: it is none
        ("n_sectors", np.int64),  # whose least ranges it keeps as its state
    ]
)

GAUGE = np.dtype(
    [
        ("stream", np.uint64, (4,)),
        ("gain", np.float64),  # of the unit
        ("drift_per_s", np.float64),
        ("has_begun", np.int64),
        ("values", np.float64, (MOST_VALUES,)),  # of the last reading
        ("is_warming_up", np.int64),
    ]
)

# A path of a plume's axis, sideways or upward.
WANDER = np.dtype([("stream", np.uint64, (4,)), ("n_knots", np.int64)])

ON_GROUND, TAKING_OFF, FLYING, HOLDING = 0, 1, 2, 3
# How searches are flown on.
BEGIN, STEP, FINISH = 0, 1, 2
NO_TASK, CRUISE, GO_TO, HOLD = 0, 1, 2, 3
SEARCHES_ON, SUCCESS, TIME_LIMIT, COLLISION, OUT_OF_BOUNDS = 0, 1, 2, 3, 4
OUTCOMES = ("", "success", "time_limit", "collision", "out_of_bounds")

SEARCH = np.dtype(
    [
        ("case", np.int64),
        ("seed", np.int64),
        ("n_begun", np.int64),
        ("tick", np.int64),
        ("position_m", np.float64, (3,)),  # world frame; with its attitude a pose of seven numbers
        ("quaternion_wxyz", np.float64, (4,)),
        ("velocity_m_s", np.float64, (3,)),  # world frame; with its rates in the body frame a motion of six
        ("rates_rad_s", np.float64, (3,)),
        ("acceleration_m_s2", np.float64, (3,)),  # in the last physics step
        ("force_m_s2", np.float64, (3,)),  # per mass, of one whose force lags
        ("yaw_sin", np.float64),
        ("yaw_cos", np.float64),
        ("tick_start_m", np.float64, (3,)),  # where it was at the beginning of the tick
        ("touched_at", np.int64),  # physics step of the tick before which it touched something; -1: none
        ("path_length_m", np.float64),
        ("is_touching", np.int64),  # what it must not
        ("is_bumped", np.int64),
        # The guide.
        ("phase", np.int64),
        ("has_leg", np.int64),
        ("leg_end_m", np.float64, (3,)),
        ("leg_hold_ticks", np.int64),
        ("has_target", np.int64),
        ("keeps_velocity", np.int64),
        ("kept_velocity_m_s", np.float64, (3,)),
        ("is_preparing", np.int64),
        ("prepares_since_tick", np.int64),
        ("hold_until_tick", np.int64),
        ("notice", np.int64),
        ("goal", np.int64),
        ("goal_vector", np.float64, (3,)),
        ("kept_task", np.int64),
        ("kept_vector", np.float64, (3,)),
        ("is_asked", np.int64),
        # The referee.
        ("outcome", np.int64),
        ("command_tick", np.int64),  # at which the last command takes effect
        ("n_commands", np.int64),
        ("scored_distance_m", np.float64),
        ("scored_place_m", np.float64, (3,)),
        ("scored_path_length_m", np.float64),
        ("scored_n_commands", np.int64),
        ("found_sources", np.int64),  # a bit for each
    ]
)

# All cases and the scratch of a thread go from kernel to kernel as one record of addresses each: an array costs a call
# seven numbers, and a tuple of arrays a hundred.
CASES = np.dtype(
    [
        ("n_cases", np.int64),
        ("n_sensors", np.int64),
        ("n_places", np.int64),
        ("rooms", np.int64),  # addresses of what `Cases` has
        ("n_rooms", np.int64),
        ("cases", np.int64),
        ("vehicles", np.int64),
        ("plumes", np.int64),
        ("n_plumes", np.int64),
        ("tapes", np.int64),
        ("n_tapes", np.int64),
        ("frames", np.int64),
        ("n_frames", np.int64),
        ("frame_of_update", np.int64),
        ("n_frame_of_update", np.int64),
        ("strengths", np.int64),
        ("gas_of_source", np.int64),
        ("n_strengths", np.int64),
        ("instruments", np.int64),
        ("names", np.int64),
        ("n_names", np.int64),
        ("start_rows", np.int64),
        ("n_start_rows", np.int64),
        ("sources_m", np.int64),
        ("n_sources", np.int64),
        ("places_m", np.int64),
    ]
)

WORK = np.dtype(
    [
        ("states", np.float64, (3, 3, 3)),  # for planning, as are the two records of `records.STATE`
        ("paths", np.int64),
        ("n_places", np.int64),
        ("places_m", np.int64),  # addresses of (n_places, 3) float64: where sensors are, how they move, the wind there
        ("velocity_m_s", np.int64),
        ("wind_m_s", np.int64),
        ("ppm", np.int64),  # address of (n_places, MOST_GASES) float64
        ("rotation", np.float64, (9,)),  # of the vehicle
        ("force", np.float64, (6,)),  # on a rigid body: force, world frame [N], and torque, body frame [N m]
        ("acceleration", np.float64, (6,)),  # of one, world frame [m/s^2] and body frame [rad/s^2]
        ("sample", np.float64, (SAMPLE_LENGTH,)),
        ("raw", np.float64, (MOST_VALUES,)),
        ("numbers", np.float64, (MOST_NUMBERS,)),
        ("most_filaments", np.int64),  # of what follows: see `gas_readings`
        ("hits", np.int64),  # address of int32
        ("slots", np.int64),  # address of int32
        ("marks", np.int64),  # address of (most_filaments // 64 + 1,) uint64
        ("is_nearby", np.int64),  # address of uint8
        ("shares", np.int64),  # address of float64, work space of `spatial_index`
    ]
)


class Cases(NamedTuple):
    """All cases, read-only: (n,) records of `ROOM`, `CASE`, `records.CONSTANTS`, `PLUME`, `TAPE` and `FRAME`.

    `frame_of_update` says which frame holds from each of a case's updates on, -1 for none; `strengths`
    [ppm m3] and `gas_of_source` (n,) of the sources of filaments; `instruments` (n_cases, n_sensors) records of
    `INSTRUMENT`; `names` bytes of their random streams; `start_rows` (n, N_START_NUMBERS) a vehicle's state at the end
    of each tick in which it leaves what it stands on; `sources_m` (n, 3); `places_m` (n_cases, n_places, 3) of the
    sensors in the body frame [m].
    """

    rooms: Any
    cases: Any
    vehicles: Any
    plumes: Any
    tapes: Any
    frames: Any
    frame_of_update: Any
    strengths: Any
    gas_of_source: Any
    instruments: Any
    names: Any
    start_rows: Any
    sources_m: Any
    places_m: Any


class Searches(NamedTuple):
    """All searches: (n,) records of `SEARCH` and `records.STATE`, (n, n_sensors) of `GAUGE`, and (n, n_memory) numbers.

    The latter are states and samples of late of sensors, see `sensors`, and knots of the (n, n_wanders) records of
    `WANDER`.
    """

    searches: Any
    paths: Any
    gauges: Any
    memory: Any
    wanders: Any


class ThreadScratch(NamedTuple):
    """Scratch of one thread: (1,) record of `WORK`, and the arrays that it points into."""

    record: Any
    kept: tuple[Any, ...]


class TouchState(NamedTuple):
    """A vehicle after a tick in which it may have touched something: `is_touched` (1,) whether it has.

    `rotation` (9,) are the rows of the matrix that turns body-frame into world-frame vectors; `places_m` and
    `velocity_m_s` (n_places, 3) are those of its sensors, world frame.
    """

    is_touched: Any
    rotation: Any
    places_m: Any
    velocity_m_s: Any


def new_touch(n_places: int) -> TouchState:
    """Return the buffers for the state of a vehicle's contacts."""
    places_m = np.zeros((n_places, 3))
    return TouchState(
        is_touched=np.zeros(1, np.int64), rotation=np.zeros(9), places_m=places_m, velocity_m_s=places_m.copy()
    )


def build_scratch(n_places: int, most_filaments: int, state_dtype: np.dtype[Any]) -> ThreadScratch:
    """Return the scratch of a thread.

    Args:
        n_places: Places that are sampled for a vehicle.
        most_filaments: How many filaments a frame of a tape has at most.
        state_dtype: `records.STATE`.
    """
    record = np.zeros(1, WORK)
    arrays = {
        "paths": np.zeros(2, state_dtype),
        "places_m": np.zeros((n_places, 3)),
        "velocity_m_s": np.zeros((n_places, 3)),
        "wind_m_s": np.zeros((n_places, 3)),
        "ppm": np.zeros((n_places, MOST_GASES)),
        "hits": np.zeros(most_filaments, np.int32),
        "slots": np.zeros(most_filaments, np.int32),
        "marks": np.zeros(most_filaments // 64 + 1, np.uint64),
        "is_nearby": np.zeros(most_filaments, np.uint8),
        "shares": np.zeros(most_filaments),
    }
    record["n_places"], record["most_filaments"] = n_places, most_filaments
    for name, array in arrays.items():
        record[name] = array.ctypes.data
    return ThreadScratch(record=record, kept=tuple(arrays.values()))


def build_cases_record(cases: Cases) -> NDArray[np.void]:
    """Return the (1,) record of `CASES` that points into cases, which have to be kept."""
    record = np.zeros(1, CASES)
    for name, array in cases._asdict().items():
        assert array.flags.c_contiguous, name
        record[name] = array.ctypes.data
        if f"n_{name}" in (CASES.names or ()):
            record[f"n_{name}"] = len(array)
    record["n_cases"], record["n_sensors"] = cases.instruments.shape
    record["n_places"] = cases.places_m.shape[1]
    return record
