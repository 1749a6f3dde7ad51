"""What the kernels of the batch know: rooms, cases, instruments, and the state of each search, as arrays of records."""

import numpy as np

# Where arrays of different shapes are told by their address, the Python side keeps them alive.
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
    ]
)

STEADY_PLUMES, NO_GAS = 0, -1
# What the referee asks for.
NEAREST_SOURCE, ALL_SOURCES = 0, 1

CASE = np.dtype(
    [
        ("room", np.int64),
        ("tick_ns", np.int64),
        ("tick_s", np.float64),
        ("n_substeps", np.int64),
        ("physics_step_s", np.float64),
        ("radius_m", np.float64),
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
        ("diagonal_m", np.float64),
        ("gas", np.int64),  # STEADY_PLUMES …
        ("first_plume", np.int64),
        ("n_plumes", np.int64),
        ("n_gases", np.int64),
        ("gas_step_s", np.float64),
        ("gas_steps_per_tick", np.int64),
        ("gas_ticks_per_step", np.int64),
        ("warm_up_steps", np.int64),
        ("warm_up_s", np.float64),
        ("centre_m", np.float64, (3,)),  # for the numbers of an observation
        ("half_m", np.float64, (3,)),
    ]
)

# What a sensor is, and what comes of its readings.
MOX, ANEMOMETER = 0, 1
# How values become numbers of an observation.
LOG_RESISTANCE, PLANAR_WIND = 0, 1
MOST_GASES = 8

INSTRUMENT = np.dtype(
    [
        ("kind", np.int64),
        ("place", np.int64),  # which of the places that are sampled
        ("numbers", np.int64),  # how its values become numbers
        ("n_values", np.int64),
        ("first_number", np.int64),  # where they stand in an observation
        ("first_name", np.int64),  # of its random stream
        ("n_name", np.int64),
        ("has_errors", np.int64),  # whether what follows counts
        ("n_with_errors", np.int64),
        ("noise_std", np.float64),
        ("bias", np.float64),
        ("drift_per_s", np.float64),
        ("max_value", np.float64),
        ("least_value", np.float64),
        ("period_ticks", np.int64),
        ("warm_up_ticks", np.int64),
        ("speed_noise", np.float64),
        ("direction_noise", np.float64),
        ("r0_ohm", np.float64),
        ("air_ratio", np.float64),
        ("rise_frac", np.float64),
        ("decay_frac", np.float64),
        ("law_a", np.float64, (MOST_GASES,)),  # of each gas; 0: it has no effect
        ("law_b", np.float64, (MOST_GASES,)),
        ("has_estimate", np.int64),
        ("estimate_a", np.float64),
        ("estimate_b", np.float64),
        ("estimate_number", np.int64),
    ]
)

GAUGE = np.dtype(
    [
        ("stream", np.uint64, (4,)),
        ("has_begun", np.int64),
        ("ratio", np.float64),
        ("values", np.float64, (3,)),  # of the last reading
        ("is_warming_up", np.int64),
    ]
)

ON_GROUND, TAKING_OFF, FLYING, HOLDING = 0, 1, 2, 3
NO_TASK, CRUISE, GO_TO, HOLD = 0, 1, 2, 3
SEARCHES_ON, SUCCESS, TIME_LIMIT, COLLISION, OUT_OF_BOUNDS = 0, 1, 2, 3, 4
OUTCOMES = ("", "success", "time_limit", "collision", "out_of_bounds")

SEARCH = np.dtype(
    [
        ("case", np.int64),
        ("seed", np.int64),
        ("n_begun", np.int64),
        ("tick", np.int64),
        ("position_m", np.float64, (3,)),
        ("velocity_m_s", np.float64, (3,)),
        ("path_length_m", np.float64),
        ("is_touching", np.int64),
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
        ("scored_path_length_m", np.float64),
        ("scored_n_commands", np.int64),
        ("found_sources", np.int64),  # a bit for each
    ]
)
