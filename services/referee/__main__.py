"""Run the referee service: `python -m gslcosim_services.referee`."""

from gslcosim.runtime.service import serve

if __name__ == "__main__":
    serve("referee")
