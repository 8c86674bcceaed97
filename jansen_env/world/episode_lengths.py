"""Lengths of n robots that hold for an episode: given at a reset, drawn, observed, saved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import instance, listed, shown
from jansen_env.dynamics.reduced import CONVERGED, compile_robot
from jansen_env.gravity import GRAVITY
from jansen_env.parameters import EVERY, Distribution
from jansen_env.plants.base import static_deflection
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import nearest_dead_point
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.soundness import check_loaded, check_standing
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.settings import Values

MARGIN = 0.12  # least sine of the angle between two links that meet in a drawn robot
ATTEMPTS = 200  # draws of a robot's lengths: of 10 % each, six in ten will do


class Build(NamedTuple):
    """A robot of an episode to come: itself, and with those lengths that are not its own, m."""

    nominal: Robot
    changed: dict[str, float]
    robot: Robot


class EpisodeLengths:
    """Lengths of n robots in their present episodes.

    Args:
        robots: with their own lengths. randomizations: of each; "lengths" counts.
        observed: whether observations show the lengths.
        standing: whether robots have to stand, as those do whose chassis is not held in the air.

    Attributes:
        constructed: the robots at first. nominal: robots with their own lengths, as exchanged by
            resets and changed since. changed: of each, lengths of this episode that are not its
            own, m.
            factors: of each, distributions of factors by length.
        entries: numbers for observations. values: (n,) all lengths of this episode, m, by name;
            None where they are neither drawn nor observed.

    Raises:
        ValueError: a name of a length that a robot does not have.
    """

    def __init__(
        self,
        robots: Sequence[Robot],
        randomizations: Sequence[Values],
        observed: bool,
        standing: bool = True,
    ) -> None:
        self._standing = standing
        self.constructed, self.nominal = list(robots), list(robots)
        self.changed: list[dict[str, float]] = [{} for _ in robots]
        self.entries: list[Observed] = []
        self.values: NDArray[np.void] | None = None
        given = [ranges.get("lengths", {}) for ranges in randomizations]
        self.factors: list[dict[str, Distribution]] = given
        if not observed and not any(given):
            return
        names = [*lengths(robots[0])]
        self.values = np.zeros(len(robots), [(name, "f8") for name in names])
        self.factors = [_by_name(factors, names) for factors in given]
        if observed:
            limits = -np.inf, np.inf
            self.entries = [Observed(f"length_{name}", "1", *limits, EXACT) for name in names]

    def connect(self, columns: Mapping[str, int], observation: NDArray[np.float32]) -> None:
        """Take the array of observations (n, d), and its columns by name."""
        self._columns = np.array([columns[entry.name] for entry in self.entries], np.int64)
        self._observation = observation
        self._note(range(len(self.nominal)))

    def plan(
        self, i: int, given: Mapping[str, float], seed: int | None, robot: Robot | None = None
    ) -> Build | None:
        """The robot of the next episode, or None if nothing changes.

        Args:
            given: lengths of that episode, m, by name. seed: of drawn ones, None for none.
            robot: that comes in its place; None for none.

        Raises:
            ValueError: an unknown name, a length out of range, or draws that nothing can turn.
        """
        drawn = {} if seed is None else self.factors[i]
        instance("lengths", given, Mapping)
        if robot is None and not (given or drawn or self.changed[i]):
            return None
        nominal = robot or self.nominal[i]
        if self.values is not None and (*lengths(nominal),) != (names := self.values.dtype.names):
            raise ValueError(f"lengths of a robot are {[*lengths(nominal)]}, must be {names}")
        if robot is not None:  # which later episodes have with its own lengths, or drawn ones
            static_deflection(robot, GRAVITY)
            if drawn and given:
                self._draw(robot, {}, drawn, np.random.default_rng((seed or 0, 0)))
        if not {*drawn} <= {*given}:
            # Commands that change in an episode are drawn by its seed and a step, from 1 on.
            return self._draw(nominal, given, drawn, np.random.default_rng((seed or 0, 0)))
        build = _build(nominal, given)
        if given:
            check_loaded("lengths", build.robot, self._standing)
        static_deflection(build.robot, GRAVITY)  # or its feet are too soft
        return build

    def _draw(
        self,
        nominal: Robot,
        given: Mapping[str, float],
        factors: Mapping[str, Distribution],
        rng: np.random.Generator,
    ) -> Build:
        """Draw the lengths that are not given until the robot can turn, well off any dead point."""
        before, reason = lengths(nominal), ""
        for _ in range(ATTEMPTS):
            drawn = {name: before[name] * factor.sample(rng) for name, factor in factors.items()}
            try:
                build = _build(nominal, {**drawn, **given})
                sine, joint, angle = nearest_dead_point(build.robot)
                if sine >= MARGIN:
                    if self._standing:
                        check_standing(build.robot)
                    static_deflection(build.robot, GRAVITY)
                    if compile_robot(build.robot).tail <= CONVERGED:
                        return build
                reason = (
                    f"links that meet in {joint} come near one line at crank angle {angle:.3f} rad"
                )
            except ValueError as error:
                reason = str(error)
        raise ValueError(
            f"randomize['lengths'] gave no robot that turns its crank in {ATTEMPTS} draws; of the "
            f"last one {reason}"
        )

    def begin(self, builds: Mapping[int, Build]) -> None:
        """Begin episodes with planned robots."""
        for i, build in builds.items():
            self.nominal[i], self.changed[i] = build.nominal, build.changed
        self._note(builds)

    def _note(self, which: Iterable[int]) -> None:
        """Put the lengths of robots into information and observations."""
        if self.values is None:
            return
        for i in which:
            nominal = lengths(self.nominal[i])
            now = {**nominal, **self.changed[i]}
            self.values[i] = tuple(now.values())
            if len(self._columns) > 0:  # of a length of 0, such as an offset, the change itself
                shares = [(now[k] - nominal[k]) / (nominal[k] or 1.0) for k in nominal]
                self._observation[i, self._columns] = shares

    def equipped(self, i: int, parts: Values) -> Build | None:
        """Return a robot with other parts, such as its motor, its lengths as they are."""
        return _build(replace(self.nominal[i], **parts), self.changed[i]) if parts else None


def _by_name(factors: dict[str, Distribution], names: Sequence[str]) -> dict[str, Distribution]:
    """Return distributions of factors by lengths' names, in their order."""
    every = dict.fromkeys(names, factors[EVERY]) if EVERY in factors else factors
    if unknown := [name for name in every if name not in names]:
        allowed = listed(names, unknown[0])
        raise ValueError(f"randomize['lengths'] has {shown(unknown[0])}, must be of {allowed}")
    return {name: every[name] for name in names if name in every}


def _build(nominal: Robot, given: Mapping[str, float]) -> Build:
    """Return a robot with given lengths, m."""
    robot, before = with_lengths(nominal, given) if given else nominal, lengths(nominal)
    changed = {name: float(value) for name, value in given.items() if value != before[name]}
    return Build(nominal, changed, robot)
