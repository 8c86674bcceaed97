"""A leg with less wear, as arXiv 2606.22129 found it: its table, its figures, and on which leg."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from agents.design.held_leg import NAMES, Array, held_leg_measures, in_stance, path_measures
from benchmarks.measure import chosen, machine, options, report, require, save, subplots, table
from jansen_env.robot import Bar, Leg, Robot, Triangle
from jansen_env.robot.kinematics import joint_positions, toe_positions
from jansen_env.robot.linkage import JANSEN, Dyad, Pin

HOLY = {"a": 38.0, "b": 41.5, "c": 39.3, "d": 40.1, "e": 55.8, "f": 39.4, "g": 36.7, "h": 65.7,
        "i": 49.0, "j": 50.0, "k": 61.9, "l": 7.8, "m": 15.0}  # fmt: skip
"""Theo Jansen's lengths by his letters, taken as mm."""
VARIED = "bcdefghijk"
HOLY_VARIED = np.array([HOLY[letter] for letter in VARIED])
CHANGE, FLOOR = 0.3, 0.85  # lengths may change so much; step, clearance and duty keep so much
POPULATION, RUNS = 100, 3
DENSITY = 0.05  # kg/m of a link's sides
OTHER_WAY = replace(
    JANSEN,
    bodies=tuple((name, "PDB" if joints == "PBD" else joints) for name, joints in JANSEN.bodies),
    dyads=(Dyad("B", "A", "P", 1), *JANSEN.dyads[1:]),
)
"""The same links, the upper triangle turned over: B on the other side of the way from A to P."""
PINS = tuple(Pin("C", 8, 6) if pin == Pin("C", 8, 5) else pin for pin in JANSEN.pins)
"""At C the foot turns on the lower rod: one of the ways in which three links share a pin."""
LEGS = {"the other way": OTHER_WAY, "Jansen's leg": JANSEN}
TABLE_4 = "paper's Table 4", "43.3", "25.7", "20 %", "0.0281", "0.0956", "48", "3 to 4 %"
WEAR = "wear_of_mean"
FIGURES = {"flatness": 0.72, "ripple": 0.42, WEAR: 0.44}  # the paper's, over those of its Table 4
CHOICES: dict[str, Callable[[dict[str, float]], float]] = {
    "nearest": lambda m: max(abs(m[name] - value) for name, value in FIGURES.items()),
    "best gait": lambda m: m["flatness"] + m["ripple"],
    "least wear": lambda m: m[WEAR],
}
FOUND = "the other way", "nearest"


def letters_leg(way: str, numbers: Array = HOLY_VARIED) -> Robot:
    """Return a leg of thin bars without friction, one of LEGS, with the VARIED lengths, mm."""
    varied = dict(zip(VARIED, numbers.tolist(), strict=True))
    s = {letter: 1e-3 * length for letter, length in {**HOLY, **varied}.items()}
    upper = [s["b"], s["e"], s["d"]]
    sides = {
        "frame": [math.hypot(s["a"], s["l"])], "crank": [s["m"]], "upper_rod": [s["j"]],
        "rocker": [s["c"]], "lower_rod": [s["k"]], "coupler": [s["f"]],
        "upper_triangle": upper if LEGS[way] is JANSEN else upper[::-1],
        "foot": [s["g"], s["h"], s["i"]],
    }  # fmt: skip
    return Robot(
        linkage=replace(LEGS[way], pins=PINS),
        bodies=tuple(_link(name, sides[name]) for name in JANSEN.names),
        frame_angle=math.atan2(s["l"], s["a"]),
        damping=(0.0,) * len(JANSEN.damped),
        legs=(Leg("fore"),),
    )


def _link(name: str, sides: list[float]) -> Bar | Triangle:
    mass = DENSITY * math.fsum(sides)
    if len(sides) == 1:
        return Bar(sides[0], mass).slender()
    return Triangle.from_sides(*sides, mass=mass, outward=name == "foot").slender()


def relative(way: str, numbers: Array, turns: float = 1.0, load: float = 20.0) -> dict[str, float]:
    """Return the measures of a leg over those of the holy numbers, see :func:`held_leg_measures`.

    All NaN where there is no such leg. ``turns``: of the crank a second. ``load``: N.
    """
    first = _of_holy_numbers(way, turns, load)
    try:
        found = _measures(way, numbers, turns, load)
    except ValueError:  # no triangle
        found = dict.fromkeys(first, math.nan)
    return {name: found[name] / first[name] for name in first}


def _measures(way: str, numbers: Array, turns: float, load: float) -> dict[str, float]:
    found = held_leg_measures(letters_leg(way, numbers), 2.0 * math.pi * turns, load)
    return {name.removeprefix("leg_"): value for name, value in found.items()}


def kept(way: str, numbers: Array) -> Array:
    """Return (3,) step, clearance and duty over those of the holy numbers; -1e6: no leg."""
    try:
        toe = toe_positions(letters_leg(way, numbers), np.arange(360) * math.pi / 180.0)
    except ValueError:
        return np.full(3, -1e6)
    first = _of_holy_numbers(way, 1.0, 20.0)
    return np.array(path_measures(toe[:, 0])[:3]) / [first[n] for n in NAMES[:3]]


@functools.cache
def _of_holy_numbers(way: str, turns: float, load: float) -> dict[str, float]:
    return _measures(way, HOLY_VARIED, turns, load)


def search(way: str, seed: int, generations: int) -> Array:
    """Return the front (designs, 10) of one run of NSGA-II, mm, begun all over the range."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize

    class Problem(ElementwiseProblem):  # type: ignore[misc]
        def __init__(self) -> None:
            low, high = (1.0 - CHANGE) * HOLY_VARIED, (1.0 + CHANGE) * HOLY_VARIED
            super().__init__(n_var=len(VARIED), n_obj=2, n_ieq_constr=3, xl=low, xu=high)

        def _evaluate(self, x: Array, out: dict[str, list[float]], *_: object) -> None:
            out["F"], out["G"] = [1e6] * 2, (FLOOR - kept(way, x)).tolist()
            if max(out["G"]) <= 0.0:
                m = relative(way, x)
                out["F"] = [0.5 * (m["flatness"] + m["ripple"]), m[WEAR]]

    found = minimize(Problem(), NSGA2(pop_size=POPULATION), ("n_gen", generations), seed=seed)
    return np.empty((0, len(VARIED))) if found.X is None else np.atleast_2d(found.X)


def picture(path: Path) -> None:
    """Draw both legs with the holy numbers, and the paths of their toes."""
    figure, axes = subplots(1, 2, 9.0, 4.5, sharex=True, sharey=True)
    for axis, (way, linkage) in zip(axes[0], LEGS.items(), strict=True):
        place = 1e3 * joint_positions(letters_leg(way), "fore", np.linspace(0, 2 * np.pi, 361))
        for i, j in linkage.skeleton:
            axis.plot(*place[300, [i, j]].T, "o-", color="0.4")
        toe = place[:, linkage.joints.index("T")]
        axis.plot(*toe.T)
        axis.plot(*toe[in_stance(toe[:, 1])].T, ".", color="C3")
        axis.set(title=way, xlabel="mm", aspect="equal")
    save(figure, path)


def main(arguments: list[str] | None = None) -> None:
    args = chosen(options(__doc__, "logs/durable_leg", generations=80), arguments)
    require("pymoo")
    picture(args.out / "durable_leg.png")
    baseline = [TABLE_4]
    for way in LEGS:
        m = held_leg_measures(letters_leg(way))
        baseline.append((way, f"{1e3 * m['leg_step']:.1f}", f"{1e3 * m['leg_clearance']:.1f}",
                         f"{m['leg_duty']:.1%}", f"{m['leg_flatness']:.4f}",
                         f"{m['leg_ripple']:.4f}", f"{m['leg_pin_load']:.0f}",
                         f"{m['leg_wear_of_mean'] / m['leg_wear'] - 1:+.1%}"))  # fmt: skip
    runs, generations = (1, 4) if args.quick else (RUNS, args.generations)
    rows, near = [("paper", "-28%", "-58%", "-56%", "", "29%", *[""] * len(VARIED))], HOLY_VARIED
    for way in LEGS:
        fronts = np.concatenate([search(way, seed, generations) for seed in range(runs)])
        found = [(x, relative(way, x)) for x in fronts]
        for label, badness in CHOICES.items():
            x, m = min(found, key=lambda one: badness(one[1]))
            near = x if (way, label) == FOUND else near
            rows.append((f"{way}, {label}", *(f"{m[name] - 1:+.1%}" for name in (*FIGURES, "wear")),
                         f"{max(abs(x / HOLY_VARIED - 1)):.0%}",
                         *(f"{value:.1f}" for value in x)))  # fmt: skip
    ratios = [(f"{turns:g}", f"{load:g}", f"{relative(FOUND[0], near, turns, load)[WEAR] - 1:+.1%}")
              for turns in (0.5, 1.0, 4.0) for load in (5.0, 20.0, 100.0)]  # fmt: skip
    report(
        args.out / "durable_leg.md",
        f"# A leg with less wear\n\n`python -m benchmarks.durable_leg`. {machine()}",
        table(["", "step, mm", "clearance, mm", "duty", "flatness", "ripple",
               "largest pin load, N", "wear of mean loads over wear"], baseline),
        table(["", "flatness", "ripple", "wear of mean loads", "wear", "largest change", *VARIED],
              rows),
        table(["turns/s", "load, N", "wear of mean loads"], ratios),
    )  # fmt: skip


if __name__ == "__main__":
    main()
