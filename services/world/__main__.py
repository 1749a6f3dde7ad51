"""Run the world service: `python -m gslcosim_services.world`."""

from gslcosim.runtime.service import serve

if __name__ == "__main__":
    serve("world")
