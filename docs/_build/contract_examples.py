"""Examples of each message, from which the golden vectors are made.

Together they hold every message type, and every optional field at least once with a value.
"""

import numpy as np

from gslcosim.contract.environment_messages import ProbeSample, ProbeSamples, SourceRate, WindShare
from gslcosim.contract.messages import (
    AgentResult,
    AgentScore,
    AttitudeSetpoint,
    Belief,
    BeliefScore,
    BodyPoses,
    BodyState,
    Bounds,
    Briefing,
    CameraFrame,
    CameraFrames,
    CameraImage,
    ChannelDescription,
    Command,
    ConcentrationSlice,
    Declaration,
    DriveSetpoint,
    Ending,
    FieldSamples,
    FilamentCloud,
    GasAmount,
    KnownMap,
    Message,
    MountSample,
    NominalPlume,
    Note,
    Observation,
    RadioArrival,
    RadioMessage,
    RadioReception,
    RadioTraffic,
    RadioTransmission,
    RateSetpoint,
    Reading,
    RefereeEvent,
    Score,
    SensorDescription,
    Task,
    Verdict,
    Waypoint,
)
from gslcosim.contract.participant_messages import (
    ParticipantBriefing,
    ParticipantHello,
    ParticipantInputs,
    ParticipantOutputs,
    ParticipantValues,
    PortRead,
    PortWrite,
    VehicleOfRun,
)
from gslcosim.contract.record import NumericArray

_SAMPLES = FieldSamples(
    tick=1,
    samples=(
        MountSample(
            agent="beetle",
            sensor="nose",
            gases=(GasAmount(gas="ethanol", mixing_ratio_ppm=3.5),),
            wind_world_m_s=(0.5, -0.25, 0.0),
        ),
    ),
)
PARTICIPATION_EXAMPLES: dict[str, Message] = {
    "hello": ParticipantHello(tick=0, reads=("truth/samples",), writes=("ventilation", "state"), contract="1.0"),
    "hello_of_a_source": ParticipantHello(tick=0, reads=(), writes=("state",)),
    "participant_briefing": ParticipantBriefing(
        tick=0,
        participant="air_conditioner",
        contract_version="1.0",
        scenario="warehouse_empty",
        tick_ns=100_000_000,
        period_ticks=2,
        seed=7,
        time_limit_s=300.0,
        bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=(15.0, 15.0, 8.0)),
        gases=("ethanol",),
        vehicles=(VehicleOfRun(agent="beetle", sensors=("nose", "wind")),),
        reads=(PortRead(port="truth/samples", delay_ticks=1, message="FieldSamples"),),
        writes=(
            PortWrite(word="ventilation", port="truth/wind", message="WindShare"),
            PortWrite(word="state", port="participant/air_conditioner/state", message="ParticipantValues"),
        ),
        parameters={"above_ppm": 0.5, "rooms": ("a", "b"), "is_on": True},
    ),
    "inputs_none": ParticipantInputs(tick=0, time_s=0.0, inputs={}),
    "inputs": ParticipantInputs(tick=2, time_s=0.2, inputs={"truth/samples": _SAMPLES.model_dump()}),
    "outputs": ParticipantOutputs(
        tick=2, outputs={"ventilation": {"share": 1.25}, "state": {"is_in_gas": True, "n_ticks": 3.0}}
    ),
    "values": ParticipantValues(tick=2, values={"is_in_gas": True, "n_ticks": 3.0}),
    "wind_share": WindShare(tick=2, share=1.25),
    "source_rate": SourceRate(tick=2, filaments_per_s=2.5),
    "probe_samples": ProbeSamples(
        tick=2,
        samples=(
            ProbeSample(
                probe="return_air",
                gases=(GasAmount(gas="ethanol", mixing_ratio_ppm=3.5),),
                wind_world_m_s=(0.5, -0.25, 0.0),
            ),
        ),
    ),
}


_BODY = BodyState(
    agent="beetle",
    position_world_m=(1.5, -2.25, 0.1),
    quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
    velocity_world_m_s=(0.5, 0.0, -0.0),
    angular_velocity_body_rad_s=(0.0, 0.0, 0.125),
    phase="flying",
    awaiting_command=False,
    path_length_m=12.0,
)
_AGENT_RESULT = AgentResult(
    name="beetle",
    success=False,
    outcome="time_limit",
    time_to_source_s=None,
    steps=70,
    path_length_m=52.5,
    straight_line_m=13.25,
    shortest_path_m=None,
    movement_overhead=None,
    directness=None,
    final_distance_m=4.5,
    declared_error_m=None,
)
_IMAGE = CameraImage(
    encoding="png",
    width_px=64,
    height_px=48,
    focal_px=55.5,
    centre_px=(32.0, 24.0),
    position_body_m=(0.1, 0.0, 0.02),
    quaternion_body_wxyz=(0.5, -0.5, 0.5, -0.5),
    taken_tick=64,
    data=b"\x89PNG\r\n\x1a\n\x00\xff",
)
_BELIEF = Belief(
    origin_m=(0.0, -1.5, 2.0),
    cell_m=0.5,
    probability=NumericArray.from_array(np.array([[0.5, 0.25, 0.0], [0.125, 0.0, 0.125]], np.float32)),
)
_BELIEF_SCORE = BeliefScore(expected_distance_m=1.25, mass_near_frac=0.75, cell_frac=0.5, entropy_bits=1.75)
EXAMPLES: dict[str, Message] = {
    **PARTICIPATION_EXAMPLES,
    "bodies_flying": BodyPoses(tick=7, bodies=(_BODY,)),
    "bodies_all_fields": BodyPoses(
        tick=2**32,
        bodies=(
            _BODY.model_copy(
                update={
                    "phase": "holding",
                    "awaiting_command": True,
                    "waypoint_world_m": (3.0, 4.0, 2.0),
                    "contacts": ("floor", "wall_x_min"),
                    "rejected_command": "the waypoint lies outside the room",
                    "tracking_error_m": 0.015625,
                    "planned_path_world_m": ((2.5, 3.75, 2.0), (3.0, 4.0, 2.0)),
                    "inertial_body": NumericArray.from_array(np.arange(18, dtype=np.float64).reshape(2, 9)),
                }
            ),
            _BODY.model_copy(update={"agent": "second", "phase": "failed"}),
        ),
    ),
    "samples": FieldSamples(
        tick=1,
        samples=(
            MountSample(
                agent="beetle",
                sensor="nose",
                gases=(GasAmount(gas="ethanol", mixing_ratio_ppm=3.1415926535),),
                wind_world_m_s=(0.5, -0.25, 0.0),
            ),
            MountSample(agent="beetle", sensor="wind", gases=(), wind_world_m_s=(1e-300, 1e300, -1.0), beam_m=4.5),
        ),
    ),
    "filaments_none": FilamentCloud(
        tick=0,
        gases=("ethanol",),
        position_world_m=NumericArray.from_array(np.zeros((0, 3), np.float32)),
        sigma_m=NumericArray.from_array(np.zeros(0, np.float32)),
        gas_index=NumericArray.from_array(np.zeros(0, np.uint8)),
    ),
    "filaments_two": FilamentCloud(
        tick=10,
        gases=("ethanol", "methane"),
        position_world_m=NumericArray.from_array(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], np.float32)),
        sigma_m=NumericArray.from_array(np.array([0.1, 0.2], np.float32)),
        gas_index=NumericArray.from_array(np.array([0, 1], np.uint8)),
        slices=(
            ConcentrationSlice(
                gas="ethanol",
                origin_m=(0.0, 0.0),
                cell_m=0.25,
                height_m=2.0,
                mixing_ratio_ppm=NumericArray.from_array(np.arange(6, dtype=np.float32).reshape(2, 3)),
            ),
        ),
    ),
    "images_none": CameraFrames(tick=1),
    "images": CameraFrames(tick=64, frames=(CameraFrame(agent="beetle", sensor="eye", image=_IMAGE),)),
    "radio_silence": RadioTraffic(tick=0),
    "radio": RadioTraffic(
        tick=66,
        transmissions=(
            RadioTransmission(
                sender="beetle",
                message=RadioMessage(channel="radio", text="gas at 3.5 ppm", to="second"),
                reached=("second",),
                lost=("third",),
                out_of_range=("fourth",),
            ),
            RadioTransmission(
                sender="second",
                message=RadioMessage(channel="radio", text="é"),
                refusal="radio: expected at most 1 bytes, was 2.",
            ),
        ),
        arrivals=(
            RadioArrival(
                agent="second",
                reception=RadioReception(sender="beetle", channel="radio", text="here", sent_tick=65, to="second"),
            ),
        ),
    ),
    "briefing": Briefing(
        tick=0,
        agent="beetle",
        contract_version="1.3",
        mission="Find the source of ethanol: come within 1 m of it in 300 s.",
        tick_ns=100_000_000,
        seed=1_234_567,
        mode="latency",
        latency_ticks=5,
        gas="ethanol",
        bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=(15.0, 15.0, 8.0)),
        search_height_m=2.0,
        hold_s=2.0,
        time_limit_s=300.0,
        sensors=(
            SensorDescription(
                name="nose", model="tgs2600", quantity="resistance", unit="ohm", mount_body_m=(0.0, 0.0, 0.05)
            ),
            SensorDescription(
                name="ahead",
                model="range_finder",
                quantity="range",
                unit="m",
                mount_body_m=(0.1, 0.0, 0.0),
                mount_rpy_rad=(0.0, 0.5, 0.0),
                directions_body=NumericArray.from_array(np.array([[0.75, 0.0, -0.5]], np.float32)),
            ),
        ),
        contract_hash="00112233445566778899aabbccddeeff",
        channels=(
            ChannelDescription(name="radio", members=("beetle", "second"), range_m=5.0, delay_ticks=1, max_bytes=1024),
            ChannelDescription(name="far", members=("beetle", "second"), range_m=None, delay_ticks=10, max_bytes=64),
        ),
        parameters={
            "step_m": 0.75,
            "n_cells": 40,
            "declares": True,
            "wall_rule": "bounce",
            "weights": (0.5, 2, 1e-3),
            "sides": ("left", "right"),
        },
        known_map=KnownMap(
            origin_m=(0.0, 0.0, 2.0),
            cell_m=0.25,
            occupied=NumericArray.from_array(np.array([[0, 1, 0], [0, 0, 1]], np.uint8)),
            height_m=2.0,
        ),
        plume=NominalPlume(
            release_ppm_m3_s=1.575,
            puffs_per_s=10.0,
            initial_sigma_m=0.125,
            growth_m2_s=0.001,
            diffusivity_m2_s=0.002,
            wind_speed_m_s=1.0,
        ),
        known_sources=((5.0, 1.0, 2.0), (1.0, 10.0, 2.0)),
        task=Task(
            goal="source",
            success_radius_m=1.0,
            time_limit_s=300.0,
            distance_of="vehicle",
            is_horizontal=True,
            mass_at_least=0.5,
            command_limit=200,
            asks_for_declaration=True,
            n_sources=2,
        ),
    ),
    "observation": Observation(
        tick=65,
        agent="beetle",
        time_s=6.5,
        position_world_m=(12.0, 12.0, 2.0),
        yaw_rad=-1.5,
        velocity_world_m_s=(0.0, 0.0, 0.0),
        status="holding",
        awaiting_command=True,
        readings=(
            Reading(sensor="nose", quantity="resistance", unit="ohm", values=(48_211.5,), is_saturated=True),
            Reading(sensor="wind", quantity="wind", unit="m/s, rad", values=(0.25, 3.0), is_warming_up=True),
            Reading(
                sensor="scan",
                quantity="range",
                unit="m",
                values=(1.5,),
                array=NumericArray.from_array(np.array([[1.5, 2.5]], np.float32)),
            ),
            Reading(sensor="eye", quantity="picture", unit="1", values=(), image=_IMAGE),
        ),
        notice="Ω outside the room",
        incoming=(RadioReception(sender="second", channel="radio", text="here", sent_tick=64, to="beetle"),),
        radio_refusals=("radio: expected at most 1024 bytes, was 2000.",),
    ),
    "command_waypoint": Command(tick=65, kind="waypoint", position_world_m=(11.2, 12.0, 2.0), hold_s=1.5),
    "command_radio": Command(
        tick=65,
        kind="noop",
        outgoing=(RadioMessage(channel="radio", text="here"), RadioMessage(channel="radio", text="Ω", to="second")),
    ),
    "command_declaration": Command(
        tick=66,
        kind="declare_source",
        declaration=Declaration(position_world_m=(5.0, 1.0, 2.0), confidence=0.75),
        reason="the belief has converged",
    ),
    "command_velocity": Command(tick=66, kind="velocity", velocity_world_m_s=(0.5, -0.25, 0.0), hold_s=0.0),
    "command_mission": Command(
        tick=66,
        kind="mission",
        waypoints=(
            Waypoint(position_world_m=(1.0, 2.0, 2.0), hold_s=0.5, yaw_rad=1.5),
            Waypoint(
                position_world_m=(3.0, 2.0, 2.0),
                velocity_world_m_s=(0.0, 1.0, 0.0),
                acceleration_world_m_s2=(-0.5, 0.0, 0.0),
                after_s=2.5,
            ),
        ),
    ),
    "command_attitude": Command(
        tick=66, kind="attitude", attitude=AttitudeSetpoint(roll_rad=0.125, pitch_rad=-0.25, yaw_rad=3.0, thrust_n=15.5)
    ),
    "command_attitude_climb": Command(tick=66, kind="attitude", attitude=AttitudeSetpoint(climb_m_s=0.25)),
    "command_rates": Command(
        tick=66, kind="rates", rates=RateSetpoint(rates_body_rad_s=(0.5, -0.5, 1.0), climb_m_s=-0.25), hold_s=0.5
    ),
    "command_rates_thrust": Command(
        tick=66, kind="rates", rates=RateSetpoint(rates_body_rad_s=(0.0, 0.0, 0.0), thrust_n=0.0)
    ),
    "command_drive": Command(tick=66, kind="drive", drive=DriveSetpoint(speed_m_s=0.5, yaw_rate_rad_s=-0.5)),
    "command_heading": Command(tick=66, kind="hold", yaw_rad=-1.5),
    "command_faces_path": Command(tick=66, kind="velocity", velocity_world_m_s=(0.5, 0.0, 0.0), faces_path=True),
    "command_told_contract": Command(tick=0, kind="hold", hold_s=0.0, contract="1.1+00112233445566778899aabbccddeeff"),
    "command_noop": Command(tick=67, kind="noop"),
    "command_belief": Command(tick=68, kind="waypoint", position_world_m=(1.0, 2.0, 2.0), belief=_BELIEF),
    "command_note": Command(
        tick=68, kind="noop", note=Note(mode="casting", values={"entropy_bits": 4.5, "hits_per_s": 0.25})
    ),
    "command_belief_3d": Command(
        tick=69,
        kind="noop",
        belief=Belief(
            origin_m=(0.0, 0.0, 0.0),
            cell_m=1.0,
            probability=NumericArray.from_array(np.full((2, 1, 2), 0.25, np.float32)),
        ),
    ),
    "ending": Ending(tick=900, reason="success"),
    "score": Score(
        tick=12,
        agents=(
            AgentScore(agent="beetle", distance_to_source_m=9.5, path_length_m=3.0, n_commands=2),
            AgentScore(agent="second", distance_to_source_m=9.5, path_length_m=3.0, n_commands=2, belief=_BELIEF_SCORE),
        ),
    ),
    "score_final": Score(
        tick=900,
        agents=(),
        events=(
            RefereeEvent(agent="beetle", kind="success", text="has found the source"),
            RefereeEvent(agent=None, kind="note", text="é"),
        ),
        is_final=True,
    ),
    "verdict": Verdict(
        tick=900,
        end_reason="success",
        agents=(
            _AGENT_RESULT,
            _AGENT_RESULT.model_copy(
                update={
                    "name": "second",
                    "success": True,
                    "outcome": "success",
                    "time_to_source_s": 90.0,
                    "shortest_path_m": 12.5,
                    "movement_overhead": 3.2,
                    "directness": 0.25,
                    "declared_error_m": 0.5,
                    "declared_confidence": 0.75,
                    "belief": _BELIEF_SCORE,
                }
            ),
        ),
    ),
}
