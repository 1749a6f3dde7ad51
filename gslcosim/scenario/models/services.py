"""Services of other packages that take part in a run, with their settings."""

from typing import Annotated, ClassVar

from pydantic import Field, SerializeAsAny

from gslcosim.base.plugins import EntryPoints
from gslcosim.scenario.models.base import Name, Spec
from gslcosim.scenario.models.one_of import OneOf

# Third parties add theirs under this name; each entry point is a class that derives from `ServiceSpec`.
SERVICE_ENTRY_POINTS = "gslcosim.services"


class ServiceSpec(Spec):
    """A service of another package: `name` is that of the participant, the entry point and the process.

    The package derives from this class, narrows `name`, adds its settings, and registers how its core is built with
    `gslcosim.runtime.services.get_block_service`.

    `drives_wind` says that it writes `truth/wind`, which scales the wind of the room. Numbers and truth values of the
    messages on `recorded_ports` are recorded as curves; each port is one that it writes every tick.
    """

    drives_wind: ClassVar[bool] = False
    recorded_ports: ClassVar[tuple[str, ...]] = ()

    name: Name = Field(description="which service it is")


Service = Annotated[
    SerializeAsAny[ServiceSpec],
    OneOf(
        tag_key="name",
        base=ServiceSpec,
        own={},
        offers=EntryPoints(group=SERVICE_ENTRY_POINTS, what="service"),
        unknown="the name of a service that an installed package offers",
    ),
]
