"""The folder of the blimp: `parameters.yaml` and `blimp.xml`."""
