"""Run the cameras service: `python -m gslcosim_services.cameras`."""

from gslcosim.runtime.service import serve

if __name__ == "__main__":
    serve("cameras")
