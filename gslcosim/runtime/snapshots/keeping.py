"""Who keeps the state of a core: the core itself where it offers that, else whoever looks through it."""

from gslcosim.contract.participant import Core, Snapshots
from gslcosim.environment.model import Environment
from gslcosim.scenario.models.spec import Spec
from gslcosim.states.keeper import StateKeeper
from gslcosim.vehicles import Vehicle

# A room, a scenario and vehicles never change in a run, and are there when it goes on.
_FIXED = (Environment, Spec, Vehicle)


def keeper_of(core: Core) -> Snapshots:
    """Return what reads and brings back the state of a core that has just been built."""
    return core if isinstance(core, Snapshots) else StateKeeper(core, fixed=_FIXED)
