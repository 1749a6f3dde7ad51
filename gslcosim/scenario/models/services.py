"""Services of other packages that take part in a run, with their settings."""

from typing import Annotated, Any, cast

from pydantic import SerializeAsAny, ValidationInfo, ValidatorFunctionWrapHandler, WrapValidator

from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import Name, Spec
from gslcosim.scenario.offers import Offers

# Third parties add theirs under this name; each entry point is a class that derives from `ServiceSpec`.
SERVICE_ENTRY_POINTS = "gslcosim.services"


class ServiceSpec(Spec):
    """A service of another package: `name` is that of the participant, the entry point and the process.

    The package derives from this class, narrows `name`, adds its settings, and registers how its core is built with
    `gslcosim.runtime.participants.service_of`.
    """

    name: Name


_OFFERS = Offers(group=SERVICE_ENTRY_POINTS, base=ServiceSpec, key="name", what="service")


def _block_of_another_package(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> ServiceSpec:
    values = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
    name = values.get("name")
    if not isinstance(name, str):
        return handler(value)
    if name not in _OFFERS.names():
        names = ", ".join(_OFFERS.names()) or "there is none"
        raise broken_rule(
            key="name",
            expected=f"the name of a service that an installed package offers ({names})",
            found=f"'{name}'",
            remedy="Install the package, or correct the name.",
        )
    return _OFFERS.validated(values, info)


Service = Annotated[SerializeAsAny[ServiceSpec], WrapValidator(_block_of_another_package)]
