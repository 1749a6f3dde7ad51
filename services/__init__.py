"""Services of a run, a package each with core, models and ports; `python -m gslcosim_services NAME` starts one."""
