"""Scores of claims beside releases: place, overlap in time, rate, false events."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim_validation.cases.network_events import OVERLAP_S, find_overlaps
from gslcosim_validation.measured_suite.estimators import Claim
from gslcosim_validation.measured_suite.logs import LogCase, TrueRelease

_DAY_S = 86_400.0


@dataclass(frozen=True, kw_only=True)
class ReleaseScore:
    """Score of an entry on one release; nan and None mark what is undefined.

    Attributes:
        release: The truth.
        claims: Events that overlap it by a minute; where rows name the open source, the one about it: of several that
            were open in the same rows, each has the nearest claim that is left.
        is_exact: All of them are right about the place, but for those that are right about another release that was
            open at the same time.
        is_partly: One is.
        delay_s: From the start of the release to that of the first such event; 0 if that began before, and where rows
            name the open source.
        overlap_frac: Time that release and events share, over the time that either takes.
        place_error_m: Distance in the plan of the longest event's place from the emission point.
        rate_ratio: The longest event's rate over the true one; `is_upper_bound` says that it may be less.
    """

    release: TrueRelease
    claims: tuple[Claim, ...]
    is_exact: bool
    is_partly: bool
    delay_s: float
    overlap_frac: float
    place_error_m: float
    rate_ratio: float
    is_upper_bound: bool = False

    @property
    def is_touched(self) -> bool:
        """True if an event overlaps it."""
        return bool(self.claims)

    @property
    def outcome(self) -> str:
        """Result in one word: exact, partly, touched or missed."""
        return "exact" if self.is_exact else "partly" if self.is_partly else "touched" if self.is_touched else "missed"


@dataclass(frozen=True, kw_only=True)
class QuietDay:
    """A day of a log outside of its releases: when it begins, how long it is quiet, and events that begin in it."""

    start_s: float
    quiet_s: float
    claims: tuple[Claim, ...]


@dataclass(frozen=True, kw_only=True)
class LogScore:
    """Score of an entry on a log; `claims` are all, `false_claims` those that overlap no release."""

    releases: tuple[ReleaseScore, ...]
    quiet_days: tuple[QuietDay, ...]
    claims: tuple[Claim, ...]
    false_claims: tuple[Claim, ...]


def score_claims(case: LogCase, claims: Sequence[Claim]) -> LogScore:
    """Score the claims of an estimator on a log.

    Source:
        Exact and partly as Daniels, Jia and Hammerling 2024, Elementa, score places; the rest is ours.
    """
    ordered = tuple(sorted(claims, key=lambda claim: (claim.start_s, claim.end_s)))
    overlaps = (
        [find_overlaps(ordered, release) for release in case.releases]
        if case.site.finds_events
        else _match_sources(case, ordered)
    )
    releases = tuple(
        _score_release(case, release, tuple(ordered[i] for i in some))
        for release, some in zip(case.releases, overlaps, strict=True)
    )
    of_releases = {i for some in overlaps for i in some}
    false_claims = tuple(claim for i, claim in enumerate(ordered) if i not in of_releases)
    return LogScore(
        releases=releases,
        quiet_days=_quiet_days(case, false_claims) if case.site.finds_events else (),
        claims=ordered,
        false_claims=false_claims,
    )


# The nearest pair of a claim and a source of the same rows first; a claim without a place comes last.
def _match_sources(case: LogCase, claims: Sequence[Claim]) -> list[list[int]]:
    pairs = [
        (np.nan_to_num(_distance_m(release, claim), nan=np.inf), r, c)
        for r, release in enumerate(case.releases)
        for c, claim in enumerate(claims)
        if claim.source == release.source
    ]
    found: list[list[int]] = [[] for _ in case.releases]
    taken: set[int] = set()
    for _, r, c in sorted(pairs):
        if not found[r] and c not in taken:
            found[r].append(c)
            taken.add(c)
    return found


def _score_release(case: LogCase, release: TrueRelease, claims: tuple[Claim, ...]) -> ReleaseScore:
    own = [claim for claim in claims if not _is_of_another(case, release, claim)]
    right = [_is_right(case, release, claim) for claim in own]
    # Without places to choose from one event near the source is enough: the others are repeated estimates of it.
    is_choice = release.place is not None
    longest = max(own or claims, key=lambda claim: claim.end_s - claim.start_s) if claims else None
    return ReleaseScore(
        release=release,
        claims=claims,
        is_exact=bool(right) and (all(right) if is_choice else any(right)),
        is_partly=any(right),
        delay_s=_delay_s(case, release, claims),
        overlap_frac=_overlap_frac(release, claims) if case.site.finds_events else math.nan,
        place_error_m=math.nan if longest is None else _distance_m(release, longest),
        rate_ratio=math.nan if longest is None else longest.rate_kg_s / release.rate_kg_s,
        is_upper_bound=longest is not None and longest.is_upper_bound,
    )


def _delay_s(case: LogCase, release: TrueRelease, claims: tuple[Claim, ...]) -> float:
    if not claims:
        return math.inf
    return max(claims[0].start_s - release.start_s, 0.0) if case.site.finds_events else 0.0


def _is_right(case: LogCase, release: TrueRelease, claim: Claim) -> bool:
    if release.place is not None:
        return claim.place == release.place
    return _distance_m(release, claim) <= case.within_m


# Of a release that was open at the same time, somewhere else.
def _is_of_another(case: LogCase, release: TrueRelease, claim: Claim) -> bool:
    return not _is_right(case, release, claim) and any(
        _is_right(case, other, claim) and find_overlaps([claim], other)
        for other in case.releases
        if min(other.end_s, release.end_s) - max(other.start_s, release.start_s) >= OVERLAP_S
    )


def _distance_m(release: TrueRelease, claim: Claim) -> float:
    if claim.position_m is None:
        return math.nan
    return float(np.hypot(*(np.array(claim.position_m) - release.position_m[:2])))


# Events of one estimator may overlap each other: their union counts. The last reading lasts for its minute.
def _overlap_frac(release: TrueRelease, claims: tuple[Claim, ...]) -> float:
    if not claims:
        return 0.0
    shared_s = union_s = 0.0
    at_s = -math.inf
    for claim in claims:
        start_s, end_s = max(claim.start_s, at_s), claim.end_s + OVERLAP_S
        if end_s <= start_s:
            continue
        union_s += end_s - start_s
        shared_s += max(min(end_s, release.end_s) - max(start_s, release.start_s), 0.0)
        at_s = end_s
    return shared_s / (union_s + (release.end_s - release.start_s) - shared_s)


def _quiet_days(case: LogCase, false_claims: tuple[Claim, ...]) -> tuple[QuietDay, ...]:
    start_s = case.log.start_s
    is_quiet = np.ones(len(start_s), dtype=bool)
    for release in case.releases:
        is_quiet &= (start_s < release.start_s) | (start_s >= release.end_s)
    day = start_s // _DAY_S
    return tuple(
        QuietDay(
            start_s=float(label) * _DAY_S,
            quiet_s=float(is_quiet[day == label].sum()) * case.site.period_s,
            claims=tuple(claim for claim in false_claims if claim.start_s // _DAY_S == label),
        )
        for label in np.unique(day)
        if is_quiet[day == label].any()
    )
