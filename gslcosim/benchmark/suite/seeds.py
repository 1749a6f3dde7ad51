"""Seeds of a suite: of the suite's seed, the case and the repetition, never of the entry."""

import hashlib

_BITS = 31


def seed_of(suite_seed: int, *words: str | int) -> int:
    """Return a seed from 0 to 2^31 - 1 for what the words name, as good as independent of all others.

    seed = blake2b(suite_seed / word / word ...), its first 31 bits

    Args:
        suite_seed: The suite's, which an organiser may keep until the results are in.
        words: What it is for, for example the case and the repetition.
    """
    text = "/".join(str(word) for word in (suite_seed, *words))
    digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") >> (64 - _BITS)


def commitment(suite_seed: int) -> str:
    """Return the SHA-256 of a seed: published before, it proves afterwards that the seed was not chosen to please."""
    return hashlib.sha256(str(suite_seed).encode()).hexdigest()
