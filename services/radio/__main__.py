"""Run the radio service: `python -m gslcosim_services.radio`."""

from gslcosim.runtime.service import serve

if __name__ == "__main__":
    serve("radio")
