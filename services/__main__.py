"""Run a service of a run: `python -m gslcosim_services NAME`."""

import sys

from gslcosim.runtime.over_bus.service import main

if __name__ == "__main__":
    main(sys.argv[1:])
