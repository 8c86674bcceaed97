"""How little slip costs how much energy, with a torque that only the crank's angle shapes.

    python -m benchmarks.pareto [--policy NAME] [--search] [--out docs/profile] [--quick]

At each commanded speed CMA-ES minimises cost of transport * (slip per metre) ^ w for several w, on
ground of friction 0.8; what falls, or misses the commanded speed by 0.01 m/s after the first two
seconds, is out. The fronts are in ``benchmarks/data/pareto.json``; ``--search`` finds them again.
Draws them with the PID and the profile, and with ``--policy`` others, as ``pareto.png``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.policy import Array, Policy
from agents.profile import load_profile
from agents.profile_search import Sweep, decode, first_guess, make_search, profiles
from agents.trials import Outcome, Trials
from agents.tune import versions
from benchmarks import measure
from benchmarks.profile_scores import FRICTION, episodes, load, numbers
from jansen_env.files import write_json

DATA = Path(__file__).parent / "data" / "pareto.json"
COMMANDS = (0.1, 0.05, 0.2, 0.3, 0.5)  # m/s, in the order in which they are searched
FROM_PROFILE = (0.3,)  # ... but for those from the command next to it
WEIGHTS = (0.4, 0.2, 0.1, 0.8, 1.6)  # w, likewise; each starts from the one next to it
HARMONICS = 6
SWEEP = Sweep(generations=24, episodes=12, step_size=0.35)
FARTHEST = 0.01  # m/s: of the mean speed from the command
FALL, DRIFT = 20.0, 200.0  # what a fall of all, and 1 m/s too much, add to the loss
SCORED = 100  # episodes of each point found
SEED = 0


def loss(out: Outcome, weight: float, shape: tuple[int, int]) -> Array:
    """Of candidates (m,): the logarithm of what is minimised, and penalties."""
    whole = Outcome._make(values.reshape(shape) for values in out)
    distance = np.maximum(whole.distance.sum(axis=1), 1e-3)
    slip = np.maximum(whole.slip.sum(axis=1) / distance, 1e-4)
    transport = np.maximum(whole.work.sum(axis=1) / distance, 1e-2)
    missed = np.maximum(np.abs(whole.drift).mean(axis=1) - FARTHEST, 0.0)
    cost = np.log(transport) + weight * np.log(slip)
    return cost + FALL * whole.fell.mean(axis=1) + DRIFT * missed


def find(
    start: Array, command: float, weight: float, sweep: Sweep, trials: Trials, bar: Any
) -> Array:
    """The numbers (4 + 2 K,) of a profile for a command, m/s, and a weight."""
    rng = np.random.default_rng([SEED, round(1000 * command), round(1000 * weight)])
    search, m, n = make_search(start, sweep, rng), sweep.candidates, sweep.episodes
    for _ in range(sweep.generations):
        angles = 2.0 * np.pi * (rng.permutation(n) + rng.random(n)) / n
        tried = search.ask()
        policy = profiles(np.repeat(decode(tried), n, axis=0), trials.envs)
        seeds = np.tile(rng.integers(2**31) + np.arange(n), m)
        out = trials.run(policy, np.full(m * n, command), seeds, np.tile(angles, m))
        costs = loss(out, weight, (m, n))
        search.tell(tried, costs)
        bar.set_postfix_str(f"{command:g} m/s, w {weight:g}: loss {np.median(costs):.2f}")
        bar.update()
    return decode(search.result.xfavorite)


def search(commands: tuple[float, ...], weights: tuple[float, ...], sweep: Sweep) -> dict[str, Any]:
    """The fronts: by command the points found, each with its weight, numbers and scores."""
    trials = Trials(np.full(sweep.candidates * sweep.episodes, FRICTION))
    firsts: dict[float, Array] = {}
    fronts: dict[str, Any] = {}
    with tqdm(total=len(commands) * len(weights) * sweep.generations, unit="generation") as bar:
        for command in commands:
            found: dict[float, Array] = {}
            for weight in weights:
                near = min(found, key=lambda w: abs(np.log(w / weight)), default=None)
                begin = firsts
                if command in FROM_PROFILE:
                    begin = {command: load_profile().at(np.array([command]))[0]}
                start = first_guess(command, begin, HARMONICS) if near is None else found[near]
                found[weight] = find(start, command, weight, sweep, trials, bar)
            firsts[command] = found[weights[0]]
            fronts[f"{command:g}"] = [
                {"weight": weight, **point(found[weight], command, trials.envs),
                 "numbers": found[weight].round(5).tolist()}
                for weight in sorted(found)
            ]  # fmt: skip
    trials.close()
    return fronts


def point(found: Array, command: float, envs: Any) -> dict[str, float]:
    """Scores of numbers (4 + 2 K,) on starts that the search has not seen."""
    policy = profiles(found[None].repeat(SCORED, axis=0), envs)
    return numbers(episodes(policy, np.full(SCORED, command)))


def allowed(score: dict[str, float]) -> bool:
    """Whether a point keeps the constraints, on fresh starts with a tenth more of the error."""
    return score["falls"] == 0 and score["error"] < 1.1 * FARTHEST


def efficient(points: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those of which no other one slips less at less cost, by their slip."""
    left: list[dict[str, Any]] = []
    for p in sorted(points, key=lambda p: p["slip"]):
        if not left or p["transport"] < left[-1]["transport"]:
            left.append(p)
    return left


def draw(fronts: dict[str, Any], policies: dict[str, Policy], count: int, path: Path) -> None:
    """Slip per metre against cost of transport, a panel per command; hollow: misses its speed."""
    figure, axes = measure.subplots(1, len(fronts), 3.0 * len(fronts), 3.6)
    for axis, name in zip(axes[0], sorted(fronts, key=float), strict=True):
        for good in (True, False):
            some = [p for p in fronts[name] if allowed(p) == good]
            axis.plot([p["slip"] for p in some], [p["transport"] for p in some], "o", color="black",
                      markersize=4, fillstyle="full" if good else "none",
                      label="periodic torque" if good else "misses the speed")  # fmt: skip
            if good:
                line = efficient(some)
                axis.plot([p["slip"] for p in line], [p["transport"] for p in line], "k-", lw=0.8)
        for i, (label, policy) in enumerate(policies.items()):
            own = numbers(episodes(policy, np.full(count, float(name))))
            axis.plot(own["slip"], own["transport"], "s^Dv*"[i % 5], color=f"C{i}", label=label)
        axis.set(title=f"{name} m/s", xlabel="slip (m/m)", xscale="log")
        axis.set_xlim(2e-3, 2.0)
        axis.set_ylim(0.0, 2.4)
    axes[0, 0].set_ylabel("cost of transport")
    measure.legend_above(figure, axes[0, 0], 2 + len(policies))
    measure.save(figure, path)


def front_table(fronts: dict[str, Any]) -> str:
    """The points as Markdown."""
    head = ("m/s", "w", "slip (m/m)", "cost of transport", "RMS torque (N m)",
            "speed error (m/s)", "falls")  # fmt: skip
    rows = [
        (name, f"{p['weight']:g}", f"{p['slip']:.4f}", f"{p['transport']:.2f}",
         f"{p['torque']:.1f}", f"{p['error']:.3f}", f"{p['falls']} of {SCORED}")
        for name in sorted(fronts, key=float) for p in fronts[name]
    ]  # fmt: skip
    return measure.table(head, rows)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "docs/profile", episodes=SCORED)
    parser.add_argument("--policy", action="append", default=[], metavar="NAME",
                        help="also a run's folder or model")  # fmt: skip
    parser.add_argument("--search", action="store_true", help="find the fronts again")
    parser.add_argument("--data", type=Path, default=DATA, help="file of the fronts")
    found = measure.chosen(parser, arguments)
    try:
        policies = load(["pid", "profile", *found.policy])
    except ValueError as error:
        parser.error(str(error))
    if found.quick:
        fronts = search(COMMANDS[:1], WEIGHTS[:1], Sweep(1, 2, 0.3, 4))
    elif found.search:
        fronts = search(COMMANDS, WEIGHTS, SWEEP)
        made = {
            "command": "python -m benchmarks.pareto --search", "versions": versions(),
            "fronts": fronts,
        }  # fmt: skip
        print(f"written: {write_json(found.data, made)}")
    else:
        fronts = json.loads(found.data.read_text(encoding="utf-8"))["fronts"]
    measure.report(
        found.out / "pareto.md",
        "# How far a periodic torque can go",
        f"`python -m benchmarks.pareto`: profiles of {HARMONICS} harmonics, found on ground of "
        f"friction {FRICTION:g} with rigid feet, scored in {SCORED} episodes each on other starts.",
        front_table(fronts),
    )
    draw(fronts, policies, 2 if found.quick else found.episodes, found.out / "pareto.png")


if __name__ == "__main__":
    main()
