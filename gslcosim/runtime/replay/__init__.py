"""Past runs: state of cores, snapshots, replay, forks and comparison."""
