"""Run a service of a run: `python -m gslcosim_services NAME`."""

import sys

from gslcosim.runtime.distributed.service_main import main

if __name__ == "__main__":
    main(sys.argv[1:])
