"""`python -m gslcosim`: the same as the command `gslcosim`."""

import sys

from gslcosim.cli.main import main

sys.exit(main())
