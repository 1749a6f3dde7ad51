"""Run the fields service: `python -m gslcosim_services.fields`."""

from gslcosim.runtime.service import serve

if __name__ == "__main__":
    serve("fields")
