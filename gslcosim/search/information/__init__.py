"""Where to smell next: what a stop is hoped to gain, and planning over beliefs."""
