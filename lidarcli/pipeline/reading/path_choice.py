"""The choice of the path of one sensor: given by the log, or matched from its sweeps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from lidarcli.display.texts import Routine, counted, times
from lidarcli.formalism.path_agreement import Agreement
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.reading.needs import UNPLACED, SensorMovedError
from lidarcli.pipeline.reading.sensor_look import PERIOD, SensorLook
from lidarcli.pose import candidates
from lidarcli.pose import fit as fitting
from lidarcli.pose import matched as matching
from lidarcli.pose.findings import Key, apart_finding
from lidarcli.pose.frames import Step
from lidarcli.pose.sources import Correction, PoseChain
from lidarcli.pose.tracks import lifted, planar
from lidarcli.sweeps.findings import Finding, Fix
from lidarcli.sweeps.types import Bool, Float64, Int64, SweepBatch

SLIDING, DRIFT_NOTED = 0.05, 0.05
"""There is a note from this share of sweeps that may slide along walls on, and on a given path that drifts by so much."""
UNCHECKED, HARDLY = "unchecked: ", "the sensor hardly moves"
"""Beginning of a remark on a path that the sweeps do not judge; why that is routine."""


@dataclass(frozen=True, slots=True)
class CheckedPath:
    """The path of one sensor after a look at its sweeps."""

    verdict: str
    """told, corrected, matched or none."""
    chain: PoseChain | None = None
    """Path to use; None for none."""
    agreement: Agreement | None = None
    """Agreement of the sweeps under it."""
    fit: fitting.PoseFit | None = None
    """The steps of the given path compared with the matched ones."""
    timing: matching.Timing = field(default_factory=matching.Timing)
    """Times at which the beams are sent."""
    stamp_ns: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    """(S,) stamps of the sweeps that were matched [ns], increasing."""
    matched: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    """(S, 3) x, y [m] and yaw [rad] of the path that was matched from these sweeps, NaN without a pose."""
    pieces: Float64 = field(default_factory=lambda: np.zeros(0))
    """(S,) number of the piece of that path: one does not lie to the next as it should."""
    still: Bool = field(default_factory=lambda: np.zeros(0, bool))
    """(S,) True where the sensor is static at that sweep; empty where the sweeps do not show it."""
    drift: float = float("nan")
    """By how much places observed again agree less than those observed soon, under the given path; NaN where none are."""
    jumps: bool = False
    """True where the given path has steps that no robot makes."""
    notes: tuple[str | Finding, ...] = ()
    """Notes on the path; of what is a fault of the log, the finding."""
    remark: str = ""
    """Agreement of the sweeps under a given path, in words."""
    apart: Finding | None = None
    """The finding that no sweep has a given pose, though the log gives a path."""
    sample: candidates.SweepSample | None = None
    """Sweeps of all of the run."""

    @property
    def is_contradicted(self) -> bool:
        """True where the given path jumps, and neither its steps nor places observed again confirm it."""
        is_checked = np.isfinite(self.drift) or (self.fit is not None and self.fit.is_evaluated)
        return self.verdict != "matched" and self.jumps and not is_checked

    @property
    def is_doubtful(self) -> bool:
        """True where the sensor moves, and its sweeps neither confirm nor contradict the given path."""
        return self.remark.startswith(UNCHECKED) and not self.hardly_moves

    @property
    def hardly_moves(self) -> bool:
        """True where the sweeps say so."""
        return self.remark.endswith(HARDLY)

    def was_still(self, stamp_ns: Int64) -> Bool:
        """Return whether the sensor was static at stamps (S,) [ns], as at the sweep before."""
        at = np.maximum(np.searchsorted(self.stamp_ns, stamp_ns, "right") - 1, 0)
        found: Bool = self.still[at]
        return found

    def facts(self) -> dict[str, Any]:
        """Return the verdict for the tables' metadata and `info`."""
        found: dict[str, Any] = {"pose_verdict": self.verdict}
        if self.chain is not None and self.verdict != "matched":
            found["pose_chain"] = self.chain.frames
        if self.agreement is not None:
            found |= {"pose_agreement": _rounded(self.agreement.all), "pose_again": _rounded(self.agreement.again)}
            found["pose_drift"] = _rounded(self.drift)
        if self.fit is not None:
            found |= {"pose_fit": _rounded(self.fit.share), "pose_delay": _rounded(self.fit.delay)}
        return found | ({} if self.timing.order == matching.AUTO else {"beam_order": self.timing.order})


def _rounded(value: float) -> float | None:
    return round(value, 3) if np.isfinite(value) else None


class _GivenPath:
    """The best given path of a sensor, its steps compared with the matched ones, and the notes on it."""

    def __init__(self, key: Key, chains: Sequence[PoseChain], look: SensorLook, *, named: str) -> None:
        self.key, self.named, self._sample = key, named, look.sample
        found = candidates.given_candidates(chains, look.sample)
        self.chosen, self._best = found[0], candidates.best_given(found)
        self.jumps = fitting.jump_of(self._best.chain)
        """Longest step and widest turn that no robot makes [m, rad]; 0 for none."""
        self.evaluate(look.path)

    def evaluate(self, path: matching.MatchedPath) -> None:
        """Evaluate the steps by those of the matched path."""
        best = self._best
        stamp_ns, poses, pieces, _ = _in_order(path)
        doubted = best.drift > candidates.DRIFTS or best.by_places < 0.9
        self.taken, self.guide = best, best.chain
        given_at = partial(candidates.poses_of, best.chain)
        self.fit = fitting.evaluate_poses(stamp_ns, poses, given_at, pieces, doubted=doubted)
        if self.fit.verdict == "corrected" and not self.named:
            self._correct()
        is_missing = best.agreement.placed < 1.0 - matching.MAX_UNPLACED
        if self.steps_fit and not is_missing and not self.taken.drift > candidates.DRIFTS:
            return
        far = fitting.far_delay(stamp_ns, poses, given_at, pieces, best.chain.span_ns, _recorded(best.chain, path))
        if far is None:
            return
        corrected = self._corrected_by(far)
        if not corrected.by_places <= self.taken.by_places + candidates.CLEARLY:
            self.fit = replace(far, as_told=self.fit.share)
            self.taken, self.guide = (self.taken, self.guide) if self.named else (corrected, corrected.chain)

    def _corrected_by(self, fit: fitting.PoseFit) -> candidates.Candidate:
        """Return the best given path with the delay and the mount of a fit."""
        chain = self._best.chain
        correction = Correction(round(fit.delay * SECOND_NS), lifted(fit.mount) if any(fit.mount) else None)
        chain = replace(chain, correction=correction.after(chain.correction))
        return candidates.Candidate("corrected", chain, self._sample.agreement(chain))

    def _correct(self) -> None:
        """Take the delay and the mount with which the steps fit, unless the sweeps agree less with them."""
        best, corrected = self._best, self._corrected_by(self.fit)
        self.guide = corrected.chain
        is_told_fit = self.fit.as_told >= fitting.ACCEPTED
        # A mount of poses whose steps fit without it has to do better, other corrections only no harm.
        least = candidates.CLEARLY if is_told_fit and any(self.fit.mount) else -candidates.DRIFTS
        if not corrected.by_places < best.by_places + least:
            self.taken = corrected
        else:
            verdict = "accepted" if is_told_fit else "rejected"
            self.fit = replace(self.fit, verdict=verdict, share=self.fit.as_told, delay=0.0, mount=(0.0, 0.0, 0.0))

    @property
    def steps_fit(self) -> bool:
        """True where nothing is known against the steps."""
        return self.fit.verdict != "rejected"

    @property
    def is_likely(self) -> bool:
        """True where most steps fit, or cannot be judged."""
        return not self.fit.share < fitting.CORRECTED

    @property
    def source(self) -> str:
        """The poses in words."""
        return f"poses from {self.taken.chain.topics[0]}"

    def notes(self) -> Iterator[Finding]:
        """Yield what is to be said where the path is taken."""
        chosen, agreed, end = self.chosen, self.taken.agreement, ""
        if self.named:
            end = f"taken as they are, because {self.named}"
        if self.taken.chain.steps != chosen.chain.steps:
            words = (
                f"{chosen.by_places:.0%} of the hits agree under {chosen.chain.frames}, {self.taken.by_places:.0%} under "
            )
            yield self._finding(f"{words}{self.taken.chain.frames}: that is laid in {chosen.chain.world}")
        elif self.taken.drift > DRIFT_NOTED:
            words = f"{self.source} drift: {agreed.near:.0%} of the hits agree, {agreed.far:.0%} where seen again"
            yield self._finding(words + ("" if self.named else "; no path fits better"))
        elif any(self.jumps):
            yield self._finding(f"{self.source} {self._jumps}")
        if self.fit.verdict == "corrected":
            yield from self._corrected(end)
        if self.named and not self.steps_fit:
            yield self.unfit(f"they are taken because {self.named}")

    def replaced(self, matched: candidates.Candidate, taken: str) -> list[Finding]:
        """Return the findings on a path in place of which the matched one is `taken`."""
        return self._corrected(taken) if self.fit.verdict == "corrected" else [self._replaced(matched, taken)]

    def _replaced(self, matched: candidates.Candidate, taken: str) -> Finding:
        if self.taken.is_seen_again and matched.is_seen_again and self.steps_fit and not any(self.jumps):
            words = f"{self.source} drift ({self.taken.agreement.far:.0%} agree where seen again): {taken}"
            return self._finding(f"{words} ({matched.agreement.far:.0%})", matched=matched.agreement.far)
        return self.unfit(taken, matched=matched.agreement.all)

    def unfit(self, end: str, **evidence: float) -> Finding:
        """Return the finding on steps that do not fit the sweeps; `end`: words after it."""
        fit = self.fit
        if self.steps_fit and any(self.jumps):
            return self._finding(f"{self.source} {self._jumps}: {end}", **evidence)
        causes = [f"{fit.share:.0%} of {fit.pairs:,} steps fit" if fit.is_evaluated else "no step can be judged"]
        if np.isfinite(fit.ratio) and not fitting.RATIOS[0] <= fit.ratio <= fitting.RATIOS[1]:
            factor = f"{fit.ratio:,.0f}" if fit.ratio >= 100 else f"{fit.ratio:.3g}"
            causes.append(f"told steps are {factor} times those seen")
        if np.isfinite(fit.turn_ratio) and fit.turn_ratio < -0.5:
            causes.append("the sensor turns the other way")
        if any(self.jumps):
            causes.append(f"they {self._jumps}")
        # A share says little where a cause is known.
        why = "; ".join(causes[1:] or causes)
        return self._finding(f"{self.source} do not fit the sweeps ({why}): {end}", **evidence)

    def remark(self) -> str:
        """Return how well the path agrees with the sweeps, in words; empty where another one is taken in its frame."""
        fit = self.fit
        if self.taken.chain.steps != self.chosen.chain.steps:
            return ""
        if self.taken.is_seen_again:
            return f"{self.taken.agreement.all:.0%} of the hits agree over the run"
        if fit.is_evaluated:
            return f"{fit.share:.0%} of {fit.pairs:,} steps fit; nothing is seen twice: drift cannot be told"
        why = HARDLY if fit.pairs < fitting.MIN_PAIRS else "too few sweeps could be matched"
        if fit.moves and fit.pairs < fitting.MIN_PAIRS:
            why = f"only {counted(fit.pairs, 'step')} of its sweeps can be compared"
        return f"{UNCHECKED}{why}"

    def no_path(self, words: str) -> Finding:
        """Return the finding that no path fits, this one neither."""
        return self._finding(f"{words}, {self.source} {self.taken.agreement.all:.0%} of the hits agree: no poses")

    @property
    def _jumps(self) -> str:
        length, turn = self.jumps
        words = [f"{length:,.1f} m"] if length else []
        return "jump by up to " + " and ".join(words + ([f"{np.degrees(turn):.0f} degrees"] if turn else []))

    def _corrected(self, end: str) -> list[Finding]:
        """Return the findings on a delay and a mount with which the steps fit, on both if the sensor is turned by far.

        `end`: words after them.
        """
        fit = self.fit
        delay, mount = _changes(fit)
        x, y, yaw = fit.mount
        evidence = {"share": fit.share, "steps": fit.pairs, "delay": fit.delay, "x": x, "y": y, "yaw": yaw}

        def finding(rule: str, changes: list[str], limits: dict[str, float], fix: Fix | None = None) -> Finding:
            words = f"{self.source} fit only if corrected ({changes[0]}): {end}"
            words = words if end else f"{self.source} fit if corrected: {'; '.join(changes)}"
            return Finding(rule, "warning", *self.key, words, evidence, limits, fix, "stamps" if fix else "")

        is_apart = abs(yaw) > fitting.FAR_TURN
        found = []
        if delay:
            changes, fix = (
                [delay, *([mount] if mount and not is_apart else [])],
                Fix("option", f"--pose-delay {fit.delay:.2f}"),
            )
            found.append(finding("delay", changes, {"delay": fitting.MIN_DELAY}, fix))
        if is_apart or not delay:
            # Sweeps cannot tell one from the other.
            cause = ": its mount, or its first beam is elsewhere (angle_min)" if is_apart else ""
            found.append(finding("mount", [(mount or "by little") + cause], {"share": fitting.CORRECTED}))
        return found

    def _finding(self, words: str, **evidence: float) -> Finding:
        """Return the finding that this is not the path that the sweeps agree on."""
        facts = {"near": self.taken.agreement.near, "far": self.taken.agreement.far}
        if self.fit.is_evaluated:
            facts |= {"share": self.fit.share, "steps": self.fit.pairs}
        known = {name: round(value, 3) for name, value in (facts | evidence).items() if np.isfinite(value)}
        return Finding("drift", "warning", *self.key, words, known, {"drift": DRIFT_NOTED})


class PathChoice:
    """The choice of the path of one sensor, after one look at its sweeps or two."""

    def __init__(self, key: Key, look: SensorLook, *, named: str, match: bool) -> None:
        self.key, self.look, self.named, self.match = key, look, named, match
        look.sample.timing, stamp_ns = look.path.timing, look.sample.stamp_ns
        known = [chain for chain in look.chains if np.isfinite(candidates.poses_of(chain, stamp_ns)).any()]
        self.given = _GivenPath(key, known, look, named=named) if known else None
        self.is_apart = bool(look.chains and len(stamp_ns)) and look.chains[0] not in known
        """True where no sweep has a pose by the best of the given paths."""

    def first(self) -> tuple[CheckedPath, list[SensorLook]]:
        """Return the path as far as one look shows it, and the looks at all sweeps that are needed to decide."""
        look, given = self.look, self.given
        if given is None:
            if self.named or (look.is_static and not self.match):
                # Named poses are taken also where none is of the time of the sweeps.
                return self._checked("none", look.chains[0] if self.named and look.chains else None), []
            if look.is_whole:
                return self._without_told(look.path), []
            return self._checked("none", None), [self._again(None)]
        if look.is_static and not given.steps_fit and not self.named:
            return replace(self._checked("none", None), notes=(given.unfit("no poses: the sensor stands"),)), []
        is_sure = given.steps_fit and not any(given.jumps) and not given.taken.drift > candidates.DRIFTS
        if self.named or look.is_static or is_sure:
            return self._with_told(given), []
        # Steps that do not fit may mislead, or be of use still.
        guesses = [given.guide, None] if any(given.jumps) or given.fit.share < fitting.ACCEPTED else [given.guide]
        return self._with_told(given), [self._again(guess) for guess in guesses]

    def second(self, looks: Sequence[SensorLook]) -> CheckedPath:
        """Return the path after looks at all sweeps."""
        if (given := self.given) is None:
            return self._without_told(looks[0].path)
        found = [(one, look) for look in looks if (one := self._matched(look.path)) is not None]
        if not found:
            return self._with_told(given)
        # Without any guess, a path that is sharp and wrong is likelier; steps of which few fit are no better than none.
        trusted = 0.0 if any(given.jumps) or given.fit.share < 0.2 else candidates.DRIFTS

        def worth(each: tuple[candidates.Candidate, SensorLook]) -> float:
            """Return the agreement of a matched path, with a gain where trusted steps led it."""
            share = float(np.nan_to_num(each[0].by_places)) * each[0].agreement.placed
            return share + (trusted if each[1].guess is not None else 0.0)

        matched, look = max(found, key=worth)
        # All sweeps show a delay and a mount that the first ones may not.
        given.evaluate(look.path)
        standing = self.look.sample.agreement(None)
        jumps = given.jumps[0] > 0.0
        best = candidates.better_path(given.taken, matched, standing.all, is_likely=given.is_likely, jumps=jumps)
        if standing.all > best.over_run(standing.all) + candidates.STANDS_BETTER:
            return self._standing(look.path, matched, standing)
        if best is given.taken:
            return self._with_told(given, look.path)
        checked = self._with_matched(look.path, matched, is_led=look.guess is not None)
        taken = "the path is matched from the sweeps"
        return replace(checked, notes=(*given.replaced(matched, taken), *checked.notes))

    def beside(self, found: CheckedPath) -> CheckedPath:
        """Return a path with the finding on the best of the given ones, where no sweep has a pose by it."""
        if not self.is_apart:
            return found
        chain, path = self.look.chains[0], self.look.path
        recorded_ns, at = _recorded(chain, path), partial(candidates.poses_of, chain)
        far = fitting.far_delay(found.stamp_ns, found.matched, at, found.pieces, chain.span_ns, recorded_ns)
        delay = recorded_ns / SECOND_NS if far is None else far.delay
        delay += chain.correction.delay_ns / SECOND_NS if delay and chain.correction is not None else 0.0
        note = apart_finding(self.key, chain, round(delay, 2))
        # That named poses are of other times is noted anyway.
        notes = (note, *found.notes) if delay or not self.named else found.notes
        if self.given is not None:
            return replace(found, notes=(replace(note, level="warning"), *found.notes))
        fit = fitting.PoseFit("rejected", 0.0, 0, round(delay, 2) or float("nan"))
        return replace(found, fit=fit, notes=notes, apart=note)

    def _again(self, guess: PoseChain | None) -> SensorLook:
        """Return a look at all sweeps, with the order of the beams that the first look found."""
        return SensorLook((), self.look.path.timing, guess, whole=True, wanted=False)

    def _checked(self, verdict: str, chain: PoseChain | None, path: matching.MatchedPath | None = None) -> CheckedPath:
        """Return a path with all that the sweeps show."""
        path, given = path or self.look.path, self.given
        stamp_ns, poses, pieces, slides = _in_order(path)
        return CheckedPath(
            verdict,
            chain,
            fit=given.fit if given else None,
            timing=path.timing,
            stamp_ns=stamp_ns,
            matched=poses,
            pieces=pieces,
            still=matching.still_at(stamp_ns, poses, slides),
            drift=given.taken.drift if given else float("nan"),
            jumps=given is not None and any(given.jumps),
            sample=self.look.sample,
        )

    def _with_told(self, given: _GivenPath, path: matching.MatchedPath | None = None) -> CheckedPath:
        """Return the given path: the chosen chain, or another one in its fixed frame."""
        chosen, taken = given.chosen.chain, given.taken
        is_chosen = taken.chain.steps == chosen.steps
        chain = taken.chain if is_chosen else candidates.laid(taken.chain, chosen, self.look.sample.stamp_ns)
        checked = self._checked(taken.verdict, chain, path)
        return replace(checked, agreement=taken.agreement, notes=tuple(given.notes()), remark=given.remark())

    def _matched(self, path: matching.MatchedPath) -> candidates.Candidate | None:
        """Return the matched path as a candidate; None where no sweep has a pose."""
        track = path.track(*self.key)
        if track is None:
            return None
        chain = PoseChain((self.key[0],), self.key[1], track.parent, (Step(track, down=False),))
        if len(gaps := path.gaps):
            chain = replace(chain, correction=Correction(gaps=gaps))
        return candidates.Candidate("matched", chain, self.look.sample.agreement(chain))

    def _with_matched(
        self, path: matching.MatchedPath, matched: candidates.Candidate, *, is_led: bool = False
    ) -> CheckedPath:
        """Return the matched path, in the frame of a likely given one; `is_led`: by given steps where it was lost."""
        chain, stamp_ns = matched.chain, path.stamp_ns
        doubts, is_weak = [], False
        if path.restarts:
            doubts.append(f"lost {times(path.restarts)}" + ("" if is_led else " (what was driven unseen is missing)"))
        if len(path.gaps):
            missing = np.isnan(candidates.poses_of(chain, stamp_ns)[:, 0])
            doubts.append(f"{np.count_nonzero(missing):,} of {len(missing):,} sweeps fit nowhere")
            is_weak = bool(missing.mean() > UNPLACED)
        if (sliding := float(np.nanmean(path.slides))) > SLIDING:
            doubts.append(f"{sliding:.0%} may slide along walls")
        told_of = f"matched path of {self.key[0]}: {', '.join(doubts)}"
        is_weak = is_weak or bool(path.restarts) or sliding > SLIDING
        notes = (told_of if is_weak else Routine(told_of),) if doubts else ()
        given = self.given
        if given is not None and given.is_likely and not np.any(planar(given.taken.chain.at(stamp_ns)).upside_down):
            # Where the given path jumps, its world is that in which it begins.
            chain = candidates.laid(
                chain, given.taken.chain, stamp_ns[: len(stamp_ns) // 10] if given.jumps[0] else stamp_ns
            )
        return replace(self._checked("matched", chain, path), agreement=matched.agreement, notes=notes)

    def _without_told(self, path: matching.MatchedPath) -> CheckedPath:
        """Return the matched path of a sensor without given poses, unless it agrees less than standing still would."""
        matched = self._matched(path)
        if matched is None:
            name = self.key[1] or "without a name"
            note = f"no path of frame {name}: the sweeps of {self.key[0]} cannot be matched"
            return replace(self._checked("none", None, path), notes=(note,))
        standing = self.look.sample.agreement(None)
        if not self.match and standing.all > matched.over_run(standing.all) + candidates.STANDS_BETTER:
            return self._standing(path, matched, standing)
        return self._with_matched(path, matched)

    def _standing(self, path: matching.MatchedPath, matched: candidates.Candidate, standing: Agreement) -> CheckedPath:
        """Return no path, as every one agrees less than standing still."""
        words = f"no path fits the sweeps: matched {matched.agreement.all:.0%}, standing still {standing.all:.0%}"
        note = self.given.no_path(words) if self.given else f"{words} of the hits agree: no poses"
        return replace(self._checked("none", None, path), agreement=standing, notes=(note,))


def _recorded(chain: PoseChain, path: matching.MatchedPath) -> int:
    """Return the delay of given poses by record times [ns]; 0 for none."""
    ends = [(int(each.min()), int(each.max())) for each in (path.stamp_ns, path.record_ns) if len(each)]
    return chain.recorded_delay_ns(*ends) if ends else 0


def _in_order(path: matching.MatchedPath) -> tuple[Int64, Float64, Float64, Float64]:
    """Return stamps, poses, pieces and slides of a matched path by increasing stamp, each stamp once."""
    stamp_ns, order = np.unique(path.stamp_ns, return_index=True)
    return stamp_ns, path.poses[order], path.pieces[order], path.slides[order]


def _changes(fit: fitting.PoseFit) -> tuple[str, str]:
    """Return the delay and the mount of a correction in words."""
    delay = f"{abs(fit.delay):.2f} s {'late' if fit.delay > 0 else 'early'}" if fit.delay else ""
    x, y, yaw = fit.mount
    moves = [f"turned by {np.degrees(yaw):.0f} degrees"] if abs(yaw) > 0.02 else []
    if max(abs(x), abs(y)) > 0.02:
        moves.append(f"moved by {x:.2f}, {y:.2f} m")
    return delay, f"sensor {', '.join(moves)}" if moves else ""


class StaticWatch:
    """Takes the only sensor of a log without poses to be static; `SensorMovedError` where it moves, or there are two."""

    def __init__(self, order: str) -> None:
        self._look, self._keys = (
            SensorLook((), matching.Timing(order), None, whole=False, wanted=True),
            set[tuple[Key, int]](),
        )

    def paths(self, batch: SweepBatch | None) -> dict[Key, CheckedPath]:
        """Return the path at the sweeps of the next batch; after all of them (None) what `check_paths` does."""
        for frame, _, sweeps in batch.by_frame() if batch is not None else ():
            self._keys.add(((sweeps.topic, frame), sweeps.run))
            for first in range(0, len(sweeps), PERIOD):
                self._look.add(sweeps.rows(np.arange(first, min(first + PERIOD, len(sweeps)))))
                if len(self._keys) > 1 or not self._look.is_static:
                    raise SensorMovedError
        here = CheckedPath("none", stamp_ns=np.zeros(1, np.int64), still=np.ones(1, bool))
        if batch is None and self._keys:
            self._look.decide_order()
            if not self._look.is_static:
                raise SensorMovedError
            here = PathChoice(next(iter(self._keys))[0], self._look, named="", match=False).first()[0]
        return {key: here for key, _ in self._keys}
