"""The claims of the paper compared with our results, with a verdict on each claim.

The function for a claim contains the criterion by which the verdict follows from the results. No
verdict is set by hand. ``docs/paper.md`` explains why a claim holds or does not hold.
"""

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from tabulate import tabulate

from jansen_env.dynamics import projection
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.files.plain_yaml import read_yaml
from jansen_env.paper import toes
from jansen_env.paper.fixed_model import SETTLED, crank_only
from jansen_env.paper.results import FRICTIONS, SLOW, TORQUES, WALK, Results
from jansen_env.robot import paper_robot

HOLDS = "holds"
CONDITION = "holds with a condition"
FAILS = "does not hold"
# Level at which the torque is "almost constant" in the paper, and largest difference from this
# level that counts as near, both in N m.
PRINTED_LEVEL = -0.9
NEAR = 0.1
CLOSE = 0.05  # largest relative difference that counts as "constant" or "around"
ROUGHLY = 0.25  # largest relative difference that counts as "roughly constant"
CLEARLY = 0.9  # largest ratio of two heaves for which the first counts as clearly smaller
NONE = 1e-6  # largest slip per metre walked that counts as none, in m
SINGULAR = 1e-9  # largest singular value that counts as 0
ROUNDING = 1e-15  # distance below which the digits depend on the processor, in m


class Claim(NamedTuple):
    """A claim of the paper, as in ``claims.yml``, and our answer.

    Attributes:
        key: Name of the claim.
        where: Place of the claim in the paper.
        says: The claim.
        computed: Our result, as text.
        verdict: ``HOLDS``, ``CONDITION`` or ``FAILS``.
    """

    key: str
    where: str
    says: str
    computed: str
    verdict: str

    @property
    def name(self) -> str:
        """Name of the claim in words, such as ``"toe paths"``."""
        return self.key.replace("_", " ")


Answer: TypeAlias = tuple[str, str]
"""The computed result, as text, and the verdict on the claim."""


def check_claims(results: Results) -> list[Claim]:
    """Return all claims with our answers, in the order of the paper."""
    checks = (
        leg_degrees_of_freedom,
        system_degrees_of_freedom,
        torque_is_periodic,
        torque_level,
        constant_torque,
        toe_paths,
        stable_walking,
        toe_speeds,
        no_walking_without_slip,
        heave,
        more_legs,
        rotation,
        translation,
    )
    paper = read_yaml(Path(__file__).with_name("claims.yml"))
    claims = []
    for check in checks:
        entry = paper[check.__name__]
        claims.append(Claim(check.__name__, entry["where"], entry["says"], *check(results)))
    return claims


def _verdict(holds: bool, with_condition: bool = False) -> str:
    """Return the verdict on a claim that holds, holds only with a condition, or does not hold."""
    return HOLDS if holds else CONDITION if with_condition else FAILS


def leg_degrees_of_freedom(_: Results) -> Answer:
    """Compare the claim with the rank of C of all four legs over a turn."""
    robot = paper_robot()
    x = projection.system_coordinates(robot, crank_only(toes.turn(360)))
    C = projection.constraint_matrix(robot, projection.leg_sides(robot), x)
    values = np.linalg.svd(C, compute_uv=False)
    rank = (values > SINGULAR).sum(axis=-1)
    left = C.shape[-1] - int(rank.min())
    return (
        f"24 - {rank.min()} = {left} at every crank angle; the smallest singular value of C is "
        f"{values.min():.2g}",
        _verdict(left == projection.DOF and rank.min() == rank.max()),
    )


def system_degrees_of_freedom(_: Results) -> Answer:
    """Compare the claim with the ranks of the system's C with a pinned and with a free frame."""
    robot = paper_robot()
    x = projection.system_coordinates(robot, crank_only(toes.turn(60)))
    Q = x[..., : projection.DOF].reshape(60, -1)

    def rank(fixed_base: bool) -> int:
        C = projection.system_constraint_matrix(robot, Q, fixed_base)
        return int(np.linalg.matrix_rank(C).min())

    fixed = rank(fixed_base=True)
    free = rank(fixed_base=False)
    return (
        f"16 - {fixed} = {16 - fixed} with a fixed frame, and 16 - {free} = {16 - free} with a "
        f"free frame",
        _verdict(fixed == 15 and free == 12),
    )


def torque_is_periodic(r: Results) -> Answer:
    """Compare torques that are one turn apart, and count the maxima in a turn.

    The torques are taken from the end of a long run, when the effects of the start have died out.
    """
    time = r.long.time[:-1]
    torque = r.long.torque
    turn = 2.0 * np.pi
    last = time >= time[-1] - turn
    now = torque[last]
    drift = float(np.abs(now - np.interp(time[last] - turn, time, torque)).max())
    peaks = int(((now > np.roll(now, 1)) & (now >= np.roll(now, -1))).sum())
    swing = float(np.ptp(now))
    settled = r.run.torque[r.run.settled]
    return (
        f"{peaks} peaks per turn; torques one turn apart differ by at most {drift:.1e} N m, with a "
        f"range of {swing:.2f} N m; from {SETTLED:.0f} s to 10 s, the torque is "
        f"{settled.min():.3f} to {settled.max():.3f} N m, with a mean of {settled.mean():.3f} N m",
        _verdict(peaks == 2 and drift < CLOSE * swing),
    )


def torque_level(r: Results) -> Answer:
    """Compare the printed torque with the mean torque and with the torques of PID runs.

    In two of the PID runs, the crank turns the other way, or two motors turn it.
    """
    settled = r.run.settled
    mean = r.run.torque[settled]
    back = r.backwards.torque[settled]
    two = r.two_motors.torque[settled]
    near = float((np.abs(two - abs(PRINTED_LEVEL)) <= NEAR).mean())
    return (
        f"the mean torque is {r.mean_torque:.3f} N m at a constant 1 rad/s and {mean.mean():.3f} "
        f"N m under the PID controller; if the crank turns the other way, the torque is "
        f"{back.min():.2f} to {back.max():.2f} N m; with two motors, the torque of each motor is "
        f"{two.min():.3f} to {two.max():.3f} N m, and within {NEAR} N m of {abs(PRINTED_LEVEL)} "
        f"N m for {100 * near:.0f} % of the time",
        _verdict(abs(r.mean_torque - PRINTED_LEVEL) <= CLOSE * abs(PRINTED_LEVEL)),
    )


def constant_torque(r: Results) -> Answer:
    """Compute the ripple of the crank speed at constant torques.

    The robot has a fixed chassis, a fixed chassis and slender links, or walks.
    """
    fixed = [ripple.ripple for ripple in r.ripples.values()]
    slender = r.slender_ripple.ripple
    walking = {t: ripple.ripple for t, ripple in r.walking_ripples.items() if not ripple.fell}
    fallen = [torque for torque, ripple in r.walking_ripples.items() if ripple.fell]
    every = [*fixed, slender, *walking.values()]
    return (
        f"with a fixed base, the speed varies by +-{_list(round(100 * v) for v in fixed)} % at "
        f"{_list(TORQUES)} N m, and with slender links by +-{100 * slender:.0f} % at {TORQUES[2]} "
        f"N m; in a walk, it varies by +-{_list(round(100 * v) for v in walking.values())} % at "
        f"{_list(walking)} N m, and the robot falls at {_list(fallen)} N m",
        _verdict(max(every) < CLOSE, min(every) < ROUGHLY),
    )


def toe_paths(_: Results) -> Answer:
    """Check that the mirror image of a fore leg fulfils the constraints of a back leg."""
    error = toes.mirror_error(paper_robot())
    size = f"less than {ROUNDING:g}" if error < ROUNDING else f"{error:.0e}"
    return f"the paths are mirror images to {size} m", _verdict(error < 1e-12)


def stable_walking(r: Results) -> Answer:
    """Report at which constant crank speeds the robot walks, and at which it falls."""
    fallen = [walk.speed for walk in r.walks if walk.fell]
    standing = [walk.speed for walk in r.walks if not walk.fell]
    return (
        f"at a constant crank speed, the robot walks for {WALK:.0f} s at {_list(standing)} rad/s "
        f"and falls earlier at {_list(fallen)} rad/s",
        _verdict(not fallen, bool(standing)),
    )


def toe_speeds(r: Results) -> Answer:
    """Report the speed at which two standing toes move apart, and the slip of a slow walk."""
    support = r.support
    zeros = np.sort(support.zeros()) / np.pi
    part = np.abs(support.slip)
    walk = r.slow[FRICTIONS[0]]
    apart = float((part > CLOSE * part.max()).mean())
    return (
        f"the standing toes move apart at {part.mean():.3f} m/rad on average, and at 0 at "
        f"{len(zeros)} crank angles ({', '.join(f'{z:.2f}' for z in zeros)} pi); with both toes on "
        f"the ground, the slip is {support.per_turn:.3f} m per turn "
        f"({support.per_turn_of_points:.3f} m for toes without pads); in a walk at {SLOW} rad/s "
        f"with a friction coefficient of {FRICTIONS[0]}, the slip is {walk.slip:.3f} m per turn, "
        f"and the robot stands on one toe for {100 * walk.one_toe:.0f} % of the time",
        _verdict(len(zeros) == 0, apart > 1.0 - ROUGHLY),
    )


def no_walking_without_slip(r: Results) -> Answer:
    """Report the slip by friction and by crank speed, and a walk without slip."""
    walks = [walk for walk in r.walks if not walk.fell]
    slow = walks[0]
    fast = min(walks, key=lambda walk: walk.slip_per_metre)
    grip = r.slow[FRICTIONS[-1]]
    loose = r.slow[FRICTIONS[0]]
    free = r.no_slip
    return (
        f"at {SLOW} rad/s, the slip is {loose.slip:.2f} m per turn with a friction coefficient of "
        f"{FRICTIONS[0]}, and {grip.slip:.2f} m with {FRICTIONS[-1]}, where the robot stands on "
        f"one toe for {100 * grip.one_toe:.0f} % of the time; with {FRICTIONS[-1]}, the slip is "
        f"{1e3 * slow.slip_per_metre:.0f} mm per metre at {slow.speed:g} rad/s, "
        f"{1e3 * fast.slip_per_metre:.1f} mm per metre at {fast.speed:g} rad/s, and "
        f"{1e3 * free.slip_per_metre:.1f} mm per metre in {free.turns} turns "
        f"({free.turns * free.distance:.1f} m) at {free.speed:g} rad/s from another start",
        _verdict(free.fell or free.slip_per_metre > NONE),
    )


def heave(r: Results) -> Answer:
    """Report the heave of four legs, also with other interpretations of their lengths."""
    four = r.heaves[1]
    near = [abs(height - 0.03) < CLOSE * 0.03 for height in (four.level, *r.other_heaves.values())]
    shown = ", ".join(f"{1e3 * h:.1f} mm with {name}" for name, h in r.other_heaves.items())
    return (
        f"{1e3 * four.level:.1f} mm with a level chassis, {1e3 * four.standing:.1f} mm if the "
        f"robot stands on a front and a rear toe and pitches by {four.pitch:.3f} rad; {shown}",
        _verdict(all(near), near[0]),
    )


def more_legs(r: Results) -> Answer:
    """Compare the heave of 2 to 24 legs, with odd and with even numbers of phases."""
    level = {heave.legs: heave.level for heave in r.heaves}
    standing = {heave.legs: heave.standing for heave in r.heaves}

    def clearly_better(heaves: dict[int, float]) -> list[int]:
        """Return the numbers of legs with a clearly smaller heave than with two more legs."""
        return [legs for legs in range(6, 24, 4) if heaves[legs] < CLEARLY * heaves[legs + 2]]

    better = clearly_better(level)
    better_standing = clearly_better(standing)
    steady = all(b < a for a, b in pairwise(level.values()))
    shown = ", ".join(f"{legs}: {1e3 * height:.2f}" for legs, height in level.items())
    return (
        f"heave in mm by number of legs, with a level chassis: {shown}; the heave is clearly "
        f"smaller with {_list(better)} legs than with two more; if the robot stands on a front and "
        f"a rear toe, the heave is {1e3 * standing[6]:.1f} mm with 6 legs and "
        f"{1e3 * standing[24]:.2f} mm with 24, and clearly smaller with {_list(better_standing)} "
        f"legs than with two more",
        _verdict(steady and level[24] < 1e-3, level[24] < 1e-3),
    )


def rotation(r: Results) -> Answer:
    """Find the body with the largest constraint moment, with a fixed chassis and walking."""
    fixed = np.abs(r.forces[r.run.settled][..., 0]).max(axis=0)
    leading = {at: int(loads.moment.argmax()) + 1 for at, loads in r.walking_loads.items()}
    others = {at: link for at, link in leading.items() if link != 1}
    first = int(fixed.argmax()) == 0
    shown = ", ".join(
        f"on link {link} ({r.walking_loads[at].moment.max():.1f} N m) at {at[0]:g} rad/s with a "
        f"friction coefficient of {at[1]}"
        for at, link in others.items()
    )
    return (
        f"with a fixed base, the moment is largest on link {fixed.argmax() + 1} ({fixed.max():.2f} "
        f"N m; link 2: {fixed[1]:.2f} N m, other links: at most {fixed[2:].max():.2f} N m) and in "
        f"{len(leading) - len(others)} of {len(leading)} walks on link 1"
        f"{shown and '; it is largest ' + shown}",
        _verdict(first and not others, first),
    )


def translation(r: Results) -> Answer:
    """Find the body with the largest constraint force, and report the forces on the joints."""
    force = np.hypot(r.forces[..., 1], r.forces[..., 2])[r.run.settled].max(axis=0)
    pins = r.fixed_loads
    walks = r.walking_loads
    weight = float(paper_robot().bodies[6].mass) * GRAVITY
    seventh = int(force.argmax()) == 6
    on_ground = {int(loads.force.argmax()) + 1 for loads in walks.values()}
    places = {loads.place for loads in walks.values()}
    shown = ", ".join(
        f"{loads.bearing.max():.0f} N ({speed:g} rad/s, friction {mu})"
        for (speed, mu), loads in walks.items()
    )
    return (
        f"with a fixed base, the sum of the forces is largest on link {force.argmax() + 1} "
        f"({force.max():.3f} N; link 8: {force[7]:.3f} N, weight of a link: {weight:.3f} N); the "
        f"largest force at a joint is {pins.on(7):.1f} N on link 7, and {pins.bearing.max():.1f} N "
        f"on {pins.place}; in walks without the touchdowns, the sum is largest on link "
        f"{_list(sorted(on_ground))}, and the force at a joint on {' or '.join(sorted(places))}: "
        f"{shown}",
        _verdict(seventh and on_ground == {7}, seventh),
    )


def _list(values: Iterable[float]) -> str:
    """Return numbers as text, such as "1, 2 and 3", or "none"."""
    *most, last = [f"{value:g}" for value in values] or ["none"]
    return f"{', '.join(most)} and {last}" if most else last


def table(claims: Iterable[Claim]) -> str:
    """Return the claims as a table in Markdown."""
    rows = [(f"{c.name} ({c.where})", c.says, c.computed, f"**{c.verdict}**") for c in claims]
    # The cells contain whole sentences, so they are not padded to a common width.
    heads = "claim", "says", "computed", "verdict"
    return tabulate(rows, heads, "github", disable_numparse=True, stralign=None) + "\n"


def as_lines(claims: list[Claim]) -> str:
    """Return a line with the verdict on each claim, and a line with the number of claims that hold.

    The lines fit into 80 columns.
    """
    lines = [f"{c.verdict:<24}{c.name} ({c.where})" for c in claims]
    held = sum(c.verdict == HOLDS for c in claims)
    return "\n".join([*lines, f"{held} of {len(claims)} claims hold without a condition"])
