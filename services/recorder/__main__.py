"""Run the recorder service: `python -m gslcosim_services.recorder`."""

from gslcosim.runtime.service import serve

if __name__ == "__main__":
    serve("recorder")
