"""Examples of the messages between a run and a model of a user's own, for the golden vectors."""

from gslcosim.contract.messages import Bounds, FieldSamples, GasAmount, Message, MountSample
from gslcosim.contract.participation import (
    ParticipantBriefing,
    ParticipantHello,
    ParticipantInputs,
    ParticipantOutputs,
    ParticipantValues,
    PortRead,
    PortWrite,
    VehicleOfRun,
)
from gslcosim.contract.ventilation import WindShare

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
}
