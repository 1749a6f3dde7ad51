"""Suite of measured logs: estimators receive readings and wind, and a separate scorer has the releases."""
