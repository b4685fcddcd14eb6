"""Start and smoother over the drive so far: which mount, how sure, how clear, and what of the way has shown it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging import corrections
from omnivert.calibration.judging.manoeuvre import Outlook, best_manoeuvre
from omnivert.calibration.judging.observability import (
    Piece,
    Seen,
    centres,
    covariance_from_information,
    pieces,
    seen,
)
from omnivert.calibration.kalman import model
from omnivert.calibration.solver import noise, wiring
from omnivert.calibration.solver.marginal import marginal_mean
from omnivert.calibration.solver.noise import Noise
from omnivert.calibration.solver.nominal import nominal_information
from omnivert.calibration.solver.parts import AGREE, from_prior, halves, recent
from omnivert.calibration.solver.problem import Problem
from omnivert.calibration.solver.result import Outcome, Result
from omnivert.calibration.solver.seed import in_sight, seed_of
from omnivert.calibration.solver.smoother import Search, Solution, marginal
from omnivert.calibration.solver.start import started, started_wide
from omnivert.calibration.solver.stretch import AS_TOLD, Keyed, Posed, Stretch, restless
from omnivert.calibration.solver.turning import turning
from omnivert.config import Config

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MOST_MOVING = 0.34  # share of the bearings that may be of moving lines
NOISY = 1.5  # times the variance that bearings are told to have: what does not fit may have been taken for noise
HELD_RHO = 0.2  # m, where the camera is held while no place of it is better than another


class Batch:
    """Gathers keyframes; solves when told to. A long drive is solved stretch by stretch, each the next one's prior."""

    def __init__(self, config: Config, noise: Noise = AS_TOLD) -> None:
        self._config = config
        self._stretch = Stretch(config)
        self._shared: Array | None = None  # mount (eta, cx, cy) and corrections of the last solution
        self._prior = corrections.first_prior()
        self._prior_shown = self._prior.information
        self._parts = AGREE  # of those that have become the prior
        self._free = corrections.freed_at_first(config)
        self._prior_centres: list[Piece] = []
        self._centres: tuple[Piece, ...] | None = None  # of all keyframes; None when not known yet
        self._gap = 0.0
        self._seems_far = False  # bearings turn very differently from what wheels and clocks are configured to
        self._searched = 0  # keyframes at the last global start
        self._searched_kinds = 0  # different centres of rotation in it
        self._keyframes = 0  # since the beginning
        self._share = 1.0
        self._wrong = ""
        self._seen: Seen | None = None
        self._noise = noise

    def append(self, key: Keyed) -> None:
        self._stretch.append(key.stamp_s, key.wheels, key.track, key.beta, key.std)
        self._centres = None
        self._keyframes += 1

    @property
    def size(self) -> int:
        """Keyframes that are solved together now."""
        return len(self._stretch.keyframes)

    def solve(self) -> Outcome:
        """The best mount for all keyframes, if there is a single clear one."""
        result, broke = None, False
        try:
            result = self._solved()
        except ArithmeticError:
            broke = True
        if self.size >= self._config.calibration.window_keyframes:  # it shows no mount, or it would have been cut
            self._forget(self.size // 2)
        return Outcome(result, self._all_centres(), self._seen, self._share, self._wrong, self._keyframes, broke)

    def _solved(self) -> Result | None:
        """The result, if there is one.

        raises  ArithmeticError when equations are not positive definite: they are not mended
        """
        if not self.size:
            return None
        posed = self._posed()
        problem = posed.problem
        if problem.lines < 1 or problem.frames < 8 or problem.beta.size < 3 * problem.lines:
            return None
        if len(self._all_centres()) < 2:
            self._glimpse(problem)
            return None
        search = Search(problem)
        solution = self._solution(search, posed)
        if solution is None:
            return None
        if (problem.prior.free[3:] != self._free).any():  # the start has freed some
            posed = replace(posed, problem=self._opened(problem))
            search = Search(posed.problem)
        search, solution = self._freed(search, solution)
        self._shared = solution.x.shared.copy()
        result = self._result(search, posed, solution)
        if result is not None and self._config.calibration.noise == "auto":
            self._noise = noise.updated(self._noise, *result.residuals)
        self._stretch.remember(posed, solution, clear=result is not None)
        if problem.frames >= self._config.calibration.window_keyframes:
            self._cut(problem.frames // 2)
        return result

    def _all_centres(self) -> tuple[Piece, ...]:
        """Clearly different centres of rotation so far, as the wheels tell."""
        if self._centres is None:
            encoder = self._config.encoder
            ways = [k.wheels for k in self._stretch.keyframes[1:]]
            wheels = np.array([(0.0, 0.0) if w is None else w.moved_m for w in ways]).reshape(-1, 2)
            k = self._noise.wheels * encoder.noise_k_m
            found = pieces(wheels, self._config.robot.wheel_base_m, k, encoder.metres_per_tick)
            self._centres = tuple(centres(self._prior_centres + found))
        return self._centres

    def _posed(self) -> Posed:
        posed = self._stretch.posed(self._prior, self._config.calibration.window_lines, 4, self._noise)
        return replace(posed, problem=self._opened(posed.problem))

    def _solution(self, search: Search, posed: Posed) -> Solution | None:
        settings = self._config.calibration
        problem = posed.problem
        found: Solution | None = None
        if self._shared is not None:
            x = self._stretch.guess(posed, self._shared)
            found = search.continued(x, 12)
        kinds = len(self._all_centres())
        doubtful = found is None or self._gap < settings.clear_gap or not self._explains(problem, found)
        doubtful |= self._noise.bearings > NOISY or self._seems_far
        growth = problem.frames / max(self._searched, 1)
        due = growth >= (1.15 if doubtful else 1.35)
        # What was clear on one kind of motion may be wrong on the next: a new centre of rotation asks for a new search.
        if due or kinds != self._searched_kinds:
            self._searched, self._searched_kinds = problem.frames, kinds
            start = started(problem, settings.max_rho_m, settings.start_etas, settings.start_lines)
            if start is not None:
                if found is None or start.solution.score < found.score - 3.0:
                    found = start.solution
                self._gap = start.gap
            found = self._turned(problem, found)
            self._wrong = self._suspicion(problem, found)
        return found

    def _turned(self, problem: Problem, found: Solution | None) -> Solution | None:
        """The solution with the corrections freed that the turning of the bearings asks for, if that is better by far.

        Corrections far off hide all good mounts: the start must know of them before it can free them.
        """
        settings = self._config.calibration
        may = corrections.may_be_free(self._config)
        wanted = turning(problem, bool(may[0]), bool(may[2]))
        self._seems_far = wanted is not None and corrections.are_far(wanted)
        unclear = self._gap < settings.clear_gap or self._noise.bearings > NOISY
        if wanted is None or not (self._seems_far or unclear or found is None or not self._explains(problem, found)):
            return found
        before, self._free = self._free, may
        opened = self._opened(problem)
        start = started_wide(opened, wanted, settings.max_rho_m, settings.start_etas, settings.start_lines)
        if start is None or (found is not None and start.solution.score > found.score - settings.clear_gap):
            self._free = before
            return found
        self._gap = start.gap
        return start.solution

    def _opened(self, problem: Problem) -> Problem:
        """The same with those corrections free that are to be so now."""
        free = np.concatenate([np.ones(3, dtype=np.bool_), self._free])
        return replace(problem, prior=replace(problem.prior, free=free))

    def _glimpse(self, problem: Problem) -> None:
        """What a drive about one centre of rotation shows.

        No place of the camera is better than another, and a free one slides into the centre; so one is held.
        """
        settings = self._config.calibration
        if problem.frames < 1.5 * self._searched:
            return
        self._searched = problem.frames
        start = started(problem, settings.max_rho_m, 1, settings.start_lines, np.array([HELD_RHO, 0.0]))
        if start is not None:
            shown, _ = nominal_information(problem, start.solution)
            self._see(shown, start.solution)

    def _see(self, shown: Array, solution: Solution) -> None:
        settings = self._config.calibration
        self._seen = seen(
            marginal(shown + self._prior_shown, self._free),
            solution.x.mount,
            self._all_centres(),
            np.deg2rad(settings.sigma_limit_deg),
            settings.sigma_limit_m,
        )

    def _explains(self, problem: Problem, solution: Solution) -> bool:
        """Whether enough of the bearings agree; of a few bearings, a few more than usual may be wrong by chance.

        Lines that do not stand still are not asked, unless they are many.
        """
        share = self._config.calibration.clear_inliers
        asked = ~restless(problem, solution)[problem.line]
        if asked.sum() < (1.0 - MOST_MOVING) * asked.size:
            asked[:] = True
        chance = np.sqrt(share * (1.0 - share) / max(int(asked.sum()), 1))
        self._share = float(solution.weight[asked].mean()) if asked.any() else 0.0
        return bool(self._share >= share - 2.0 * chance)

    def _suspicion(self, problem: Problem, found: Solution | None) -> str:
        settings = self._config.calibration
        if found is None or self._explains(problem, found) or problem.frames < 30 or len(self._all_centres()) < 2:
            return ""
        return wiring.suspicion(
            problem, found, settings.max_rho_m, settings.clear_inliers, settings.start_etas, settings.start_lines
        )

    def _freed(self, search: Search, solution: Solution) -> tuple[Search, Solution]:
        """The solution with those corrections freed that the drive shows."""
        if len(self._all_centres()) < 2 or self._gap < self._config.calibration.clear_gap:
            return search, solution
        information, step = search.opened(solution)
        free = corrections.freed(self._config, self._free, information, step, solution.x.corrections)
        if (free == self._free).all():
            return search, solution
        self._free = free
        problem = search.problem
        again = Search(self._opened(problem))
        shared = solution.x.shared.copy()
        shared[3:] = np.where(free, shared[3:], problem.held)
        return again, again.polished(again.solved(replace(solution.x, shared=shared), problem.std, 20, 0.01), 2)

    def _result(self, search: Search, posed: Posed, solution: Solution) -> Result | None:
        settings, problem = self._config.calibration, search.problem
        shown, found = nominal_information(problem, solution)
        self._see(shown, solution)
        x = marginal_mean(search, solution)
        mount, slope = model.polar_from_cartesian(x.mount)
        if self._gap < settings.clear_gap or not self._explains(problem, solution) or mount[1] > settings.max_rho_m:
            return None
        far = corrections.are_far(solution.x.corrections)
        if far and not problem.prior.information[:3, :3].any():  # nothing yet that it could be held against
            return None
        shown = marginal(shown + self._prior_shown, self._free)
        information, step = search.opened(solution)
        apart = (
            self._parts + from_prior(problem.prior, solution.x.shared + step, information) + halves(problem, solution)
        )
        scatter = apart.scatter(1.0) if far else apart.scatter()
        covariance = slope @ covariance_from_information(marginal(information, self._free)) @ slope.T
        at = x.corrections
        newest = self._stretch.keyframes[-1]
        seed = seed_of(newest.line, newest.track, posed.names, solution, x)
        residuals = noise.components(search, solution)
        limit = np.array([np.deg2rad(settings.sigma_limit_deg), settings.sigma_limit_m, 0.0])
        limit[2] = limit[0]
        return Result(
            mount,
            covariance,
            slope @ covariance_from_information(shown) @ slope.T,
            self._gap,
            tuple(centres(self._prior_centres + found)),
            apart.disagreement,
            scatter,
            far or scatter > 1.0,
            seed,
            at.copy(),
            corrections.told(self._config, self._free, at, np.sqrt(scatter) * corrections.stds(information))
            + noise.told(self._noise, residuals, self._config.encoder.noise_k_m),
            residuals,
            self._noise,
            recent(problem, solution),
            best_manoeuvre(mount, shown, in_sight(seed), self._outlook(problem), limit),
        )

    def _outlook(self, problem: Problem) -> Outlook:
        robot, encoder, settings = self._config.robot, self._config.encoder, self._config.calibration
        return Outlook(
            robot.wheel_base_m,
            self._noise.wheels * encoder.noise_k_m,
            float(np.median(problem.std)),
            longest_m=settings.longest_straight_m,
            longest_turn_deg=settings.longest_turn_deg,
        )

    def _cut(self, count: int) -> None:
        """The first `count` keyframes become the prior of the rest. Lines across the cut start anew: counted once.

        raises  ArithmeticError when they determine nothing; all of them are solved together once more then
        """
        whole = self._stretch.keyframes
        self._stretch.keyframes = whole[:count]
        try:
            self._condense()
        finally:
            self._stretch.keyframes = whole
        self._forget(count)

    def _condense(self) -> None:
        """What all keyframes show is added to the prior, if it is clear."""
        posed = self._posed()
        problem = posed.problem
        clear = self._gap >= self._config.calibration.clear_gap and problem.lines > 0 and problem.frames > 2
        if self._shared is None or not clear:
            return
        search = Search(problem)
        solution = search.solved(self._stretch.guess(posed, self._shared), problem.std, 12, 0.01)
        shown, found = nominal_information(problem, solution)
        information, step = search.opened(solution)
        self._prior_shown = self._prior_shown + shown
        self._parts += from_prior(self._prior, solution.x.shared + step, information)
        self._prior = replace(self._prior, mean=solution.x.shared + step, information=information)
        self._prior_centres = centres(self._prior_centres + found)

    def _forget(self, count: int) -> None:
        """The first `count` keyframes are no longer solved."""
        self._stretch.drop_first(count)
        self._centres = None
        self._searched = self.size
