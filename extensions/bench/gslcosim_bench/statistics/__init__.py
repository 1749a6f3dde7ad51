"""Statistics of many runs: pure functions of arrays, each with its interval where it has one."""
