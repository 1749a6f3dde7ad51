"""Archive of results: signatures, the submission log, audits, sealed cases, bundles, sites and datasets."""
