"""Rows of runs that were never flown."""


def row(entry="a", *, case="c", repetition=0, success=True, time_s=10.0, score=0.75, gas_seed=None, status="flown"):
    return {
        "trial": f"{entry}/{case}/{repetition}",
        "entry": entry,
        "case": case,
        "scenario": case.partition("/")[0],
        "repetition": repetition,
        "status": status,
        "success": success,
        "time_s": time_s,
        "time_limit_s": 20.0,
        "score": score,
        "environment_hash": "room",
        "gas_seed": repetition if gas_seed is None else gas_seed,
    }


def lost(entry="a", **where):
    return row(entry, success=False, time_s=None, score=None, status="crashed", **where)
