"""Stored gas: frames of GADEN, GSL-Bench and AutoGDM+, and movies, played back in runs and sampled outside of them."""
