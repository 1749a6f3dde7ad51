"""Generation of environments: from a scenario's few lines to a cached folder with geometry, wind, scene and picture."""
