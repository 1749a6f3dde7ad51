"""Run the sensing service: `python -m gslcosim_services.sensing`."""

from gslcosim.runtime.service import serve

if __name__ == "__main__":
    serve("sensing")
