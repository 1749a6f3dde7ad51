"""Suite of measured logs: estimators get readings and wind, a scorer apart from them knows the releases."""
