"""From a command to a reference: what is accepted, the phases of a vehicle, avoidance and keeping apart."""
