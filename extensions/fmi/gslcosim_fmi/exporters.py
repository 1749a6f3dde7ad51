"""The format that this package registers for environments."""

from gslcosim.base.exporters import Exporter

EXPORTERS = (
    Exporter(
        name="fmu",
        of="environment",
        summary="a unit of FMI 3.0 with wind and gas",
        function="gslcosim_fmi.room_fmu:write_room_fmu",
    ),
)
