"""Speed of the environments: one, many, larger ones, harder ones, the first one, in PPO.

    python -m benchmarks.speed [--only PART ...] [--rounds 7] [--out logs/speed] [--quick]
    python -m benchmarks.speed --against TREE

Writes ``speed.md``, or ``against.md`` with this tree beside the checkout TREE of another commit.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks import measure, walks
from benchmarks.probe import OURS, STAGES, Many, Single, Tree, robots
from benchmarks.varied_robots import designs
from jansen_env import ROBOTS, Robot, paper_robot
from jansen_env.cores import available_cores
from jansen_env.terrain.generators import make_generator

MUJOCO, BOX2D = "Walker2d-v5", "BipedalWalker-v3"
FLAT, ROUGH, REAL = f"{OURS}, flat", f"{OURS}, rough", f"{OURS}, motor, bearings and feet"
SILENT, ONE_THREAD = "no information asked for", "the same on one thread"
SEGMENTS = 100  # of the rough ground
AT_ONCE, LEVEL = 256, 3  # robots of each preset; of the rough ground whose exchange is measured
SAME, OTHER = "one rough ground for all, for good", "another rough ground at each reset"
HARDCORE, BUILT = "JansenWalkerHardcore-v0", "the built robot, flat"
ROUNDS = 7
ENVIRONMENTS, ROLLOUTS = 64, 5  # of PPO, side by side; of a round, each with its update
SETTING: dict[str, Any] = {"n_steps": 64, "batch_size": 1024, "n_epochs": 6}
LAYERS = (64, 64)
NEVER = 10**9  # updates between two lines of a log
MEMORY = """
import sys
import gymnasium, numpy, psutil
import jansen_env

def used(count):
    venv = gymnasium.make_vec(sys.argv[1], num_envs=count)
    venv.reset(seed=0)
    venv.step(numpy.zeros((count, 1), numpy.float32))
    return psutil.Process().memory_info().rss / 1000.0

few, more = 16, int(sys.argv[2])
before = used(few)
print((used(few + more) - before) / more)
"""
"""Prints the memory, kB, of each of so many more robots of an environment."""


def one(rounds: int, quick: bool) -> str:
    """``gym.make`` beside its peers: random actions, wrappers and resets included."""
    steps = 200 if quick else 5000
    players = {
        FLAT: Single(OURS, steps),
        ROUGH: Single(OURS, steps, terrain=walks.rough_ground(SEGMENTS)),
        REAL: Single(OURS, steps, robot=real_robot()),
        MUJOCO: Single(MUJOCO, steps),
        BOX2D: Single(BOX2D, steps),
    }
    rates = measure.take_turns({name: player.play for name, player in players.items()}, rounds)
    duration = {name: player.step_duration for name, player in players.items()}
    rows = [
        (name, *measure.spread(rates[name]), player.resets, f"{1e3 * duration[name]:g}",
         f"{median(rates[name]) * duration[name]:,.0f}")
        for name, player in players.items()
    ]  # fmt: skip
    ratios = [
        (f"{ours} / {peer}", found, f"{found.value * duration[ours] / duration[peer]:.2f}")
        for ours in (FLAT, ROUGH)
        for peer in (MUJOCO, BOX2D)
        for found in [measure.ratio(rates[ours], rates[peer])]
    ]
    slower = measure.ratio(rates[REAL], rates[FLAT])
    ratios.append((f"{REAL} / {FLAT}", slower, f"{slower.value:.2f}"))
    head = ("environment", "steps/s", "lowest", "highest", "resets", "ms/step", "simulated s/s")
    return f"## One environment\n\n{measure.table(head, rows)}\n\n" + measure.table(
        ("ratio", "steps/s (by round)", "simulated s/s"), ratios
    )


def many(rounds: int, quick: bool) -> str:
    """``gym.make_vec`` beside a single peer and, where there is envpool, many."""
    counts = (1, 2, 3, 4) if quick else (1, 4, 16, 64, 256, 1024, 4096, 16_384)
    compared, steps = (4, 100) if quick else (256, 60_000)
    players: dict[tuple[str, int], Single | Many] = {("flat", n): robots(n, steps) for n in counts}
    rough = walks.rough_ground(SEGMENTS)
    players["rough", compared] = robots(compared, steps, terrain=rough)
    players["motor, bearings, feet", compared] = robots(compared, steps, robot=real_robot())
    players[SILENT, compared] = robots(compared, steps, info_keys=())
    players[ONE_THREAD, compared] = robots(compared, steps, info_keys=(), threads=1)
    players[MUJOCO, 1] = Single(MUJOCO, 200 if quick else 5000)
    for threads in sorted({1, available_cores()}) if importlib.util.find_spec("envpool") else ():
        name = f"envpool {MUJOCO}, {threads} thread{'s' * (threads > 1)}"
        players[name, compared] = envpool(compared, threads, 16 if quick else 100)
    rates = measure.take_turns({key: player.play for key, player in players.items()}, rounds)
    rows = [(*key, *measure.spread(found)) for key, found in rates.items()]
    ratios = [
        (f"{compared} robots{how} / {name}", measure.ratio(rates[ours, compared], rates[name, n]))
        for ours, how in (("flat", ""), (SILENT, " without information"))
        for name, n in players
        if MUJOCO in name
    ]
    gained = measure.ratio(rates[SILENT, compared], rates[ONE_THREAD, compared])
    ratios.append((f"{compared} robots on {available_cores()} cores / on one thread", gained))
    slower = measure.ratio(rates["motor, bearings, feet", compared], rates["flat", compared])
    ratios.append((f"{compared} with motor, bearings, feet / {compared} robots", slower))
    head = ("environments", "at once", "steps/s", "lowest", "highest")
    cost = {n: [1.0 / rate for rate in rates["flat", n]] for n in counts[-4:]}
    parts = [measure.table(head, rows), measure.table(("ratio", "steps/s (by round)"), ratios)]
    parts.append(
        f"Exponent of a robot's step by their number, from {counts[-4]} on: "
        f"{measure.exponent(cost):.3f}."
    )
    parts.append(measure.table(("a robot of", "memory, kB"), memory(256 if quick else 4096)))
    return "## Many environments\n\n" + "\n\n".join(parts)


def memory(robots: int) -> list[tuple[str, str]]:
    """Return names of environments, and the memory of one of so many robots, kB."""
    rows = []
    for env_id in (OURS, "JansenWalkerRough-v0", HARDCORE):
        code = [sys.executable, "-c", MEMORY, env_id, str(robots)]
        done = subprocess.run(code, capture_output=True, text=True, check=True)
        rows.append((env_id, f"{float(done.stdout):.0f}"))
    return rows


def real_robot() -> Robot:
    """The paper's links with the built robot's motor, dry bearings and feet that give."""
    built = ROBOTS["built"]()
    names = ("motor", "bearing_friction", "pad_compliance")
    return replace(paper_robot(), **{name: getattr(built, name) for name in names})


def envpool(count: int, threads: int, steps: int) -> Many:
    """envpool's ``Walker2d-v5`` on so many threads; its episodes last some 25 steps."""
    from envpool import make_gymnasium

    venv = make_gymnasium(MUJOCO, num_envs=count, num_threads=threads, seed=0)
    venv.reset()
    return Many(venv, count, venv.action_space, steps)


def size(rounds: int, quick: bool) -> str:
    """A step of walking against the number of legs and of the ground's segments, and at rest."""
    steps = 20 if quick else 400  # within an episode
    legs = (4, 24) if quick else tuple(range(4, 25, 4))
    segments = (10, 100) if quick else (10, 30, 100, 300, 1000, 3000, 10_000)
    sweeps = {
        "legs": {n: walker(steps, n) for n in legs},
        "segments of the ground": {
            n: walker(steps, terrain=walks.rough_ground(n, 100.0 / n)) for n in segments
        },
    }
    parts = ["## Larger environments\n\nA step of 20 ms of a walk at 2.7 rad/s:"]
    for name, players in sweeps.items():
        rates = measure.take_turns({n: player.play for n, player in players.items()}, rounds)
        cost = {n: [1e6 / rate for rate in found] for n, found in rates.items()}
        rows = [
            (n, *measure.spread(cost[n], ".1f"), player.resets) for n, player in players.items()
        ]
        parts.append(measure.table((name, "us", "lowest", "highest", "resets"), rows))
        growth = measure.ratio(cost[max(cost)], cost[min(cost)])
        parts.append(
            f"{max(cost)} {name} cost {growth} times as much as {min(cost)}; exponent "
            f"{measure.exponent(cost):.3f}."
        )

    resting = {dt: Single(OURS, steps, lambda _: np.zeros(1, np.float32), control_dt=dt)
               for dt in (0.02, 0.1)}  # fmt: skip
    found = measure.take_turns({dt: player.play for dt, player in resting.items()}, rounds)
    short, long = (1e6 / median(found[dt]) for dt in resting)
    each = (long - short) / 80  # time steps of 1 ms
    parts.append(f"A step at rest takes {short:.1f} us, each of its 20 time steps {each:.2f} us.")
    return "\n\n".join(parts)


def walker(steps: int, legs: int = 4, **arguments: Any) -> Single:
    """The paper's robot with so many legs; each adds the torque of its own weight and friction."""
    most = 8.0  # N m a leg

    def policy(observation: Any) -> Any:
        torque = 1.0 + 2.5 * (2.7 - observation[2])  # N m a leg
        return np.array([min(1.0, max(-1.0, torque / most))], np.float32)

    return Single(OURS, steps, policy, robot=paper_robot(legs // 2), torque_limit=legs * most,
                  **arguments)  # fmt: skip


def presets() -> dict[str, dict[str, Any]]:
    """Arguments of harder environments, by name."""
    draw = make_generator("rough")
    assert draw is not None
    scales = ("mass_scale", "inertia_scale", "damping_scale", "motor_strength")
    return {
        "flat": {},
        SAME: {"terrain": draw(np.random.default_rng(0), LEVEL)},
        OTHER: {"terrain": "rough", "terrain_level": LEVEL},
        "with a height scan": {"height_scan": (0.5, 0.9, 15)},
        "all parameters randomised": {"randomize": {
            "friction": (0.4, 1.0), "restitution": (0.0, 0.3), "payload": (0.0, 0.5),
            "payload_x": (-0.1, 0.1), "payload_y": (-0.1, 0.1), "tilt": (-0.05, 0.05),
            "delay": (0.0, 0.04), **dict.fromkeys(scales, (0.9, 1.1)),
        }},
        BUILT: {"robot": "built"},
        "JansenWalkerRough-v0": {"env_id": "JansenWalkerRough-v0"},
        HARDCORE: {"env_id": HARDCORE},
    }  # fmt: skip


def worlds(rounds: int, quick: bool) -> str:
    """Harder environments beside as many robots on flat ground."""
    steps = 2_000 if quick else 60_000
    players = {name: robots(AT_ONCE, steps, **given) for name, given in presets().items()}
    rates = measure.take_turns({name: player.play for name, player in players.items()}, rounds)
    rows = [(name, *measure.spread(found)) for name, found in rates.items()]
    pairs = [(name, "flat") for name in rates if name not in ("flat", BUILT)]
    pairs += [(OTHER, SAME), (HARDCORE, BUILT)]
    ratios = [(f"{one} / {other}", measure.ratio(rates[one], rates[other])) for one, other in pairs]
    head = (f"{AT_ONCE} robots", "steps/s", "lowest", "highest")
    return f"## Harder environments\n\n{measure.table(head, rows)}\n\n" + measure.table(
        ("ratio", "steps/s (by round)"), ratios
    )


def start(rounds: int, quick: bool) -> str:
    """The first environment on a machine, and one in a later process."""
    tree = Tree(Path(__file__).parents[1])
    cold = [tree.first() for _ in range(1 if quick else min(rounds, 3))]
    warm = [tree.later() for _ in range(rounds)]
    rows = [
        (name, *(f"{median(column):.2f}" for column in zip(*times, strict=True)),
         " to ".join(f"{bound:.2f}" for bound in (min(map(sum, times)), max(map(sum, times)))))
        for name, times in (("nothing compiled yet", cold), ("compiled before", warm))
    ]  # fmt: skip
    head = ("seconds in a new process", *STAGES, "all")
    return f"## Starting\n\n{measure.table(head, rows)}"


class Trainee:
    """PPO with some arguments, and the vector environments that it trains in."""

    def __init__(self, venv: Any, setting: dict[str, Any]) -> None:
        from stable_baselines3 import PPO

        self.inside = 0.0  # s spent in the environments
        for name in ("reset", "step_async", "step_wait"):
            setattr(venv, name, self._timed(getattr(venv, name)))
        self.label = type(venv).__name__
        self.steps = ROLLOUTS * setting["n_steps"] * venv.num_envs
        self.model = PPO("MlpPolicy", venv, policy_kwargs={"net_arch": list(LAYERS)}, seed=0,
                         device="cpu", **setting)  # fmt: skip

    def _timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            start = time.perf_counter()
            try:
                return call(*arguments)
            finally:
                self.inside += time.perf_counter() - start

        return timed

    def play(self) -> tuple[float, float]:
        """Train some rollouts on; steps/s, and the environments' share of the time."""
        before, start = self.inside, time.perf_counter()
        self.model.learn(self.steps, log_interval=NEVER, reset_num_timesteps=False)
        spent = time.perf_counter() - start
        return self.steps / spent, (self.inside - before) / spent


def ppo(rounds: int, quick: bool) -> str:
    """Stable-Baselines3's PPO: steps/s, and the environments' share of the time.

    In one batch, of as many robots and of four times as many, and in the peer's own default, with
    the same setting; and in the larger batch with the hyperparameters that ``train.py`` ships.
    """
    import torch
    from stable_baselines3.common.env_util import make_vec_env as peers_vec_env

    from agents.training.config import new_config
    from jansen_env.sb3 import make_vec_env

    count, setting = ENVIRONMENTS, SETTING
    if quick:
        count, setting = 4, {"n_steps": 8, "batch_size": 16, "n_epochs": 1}
    torch.set_num_threads(1)  # these networks are small, more threads cost more than they bring
    more = 4 * count
    shipped = new_config()["hyperparameters"]
    shipped = {name: shipped[name] for name in ("batch_size", "n_epochs")}
    trainees = {
        (OURS, count, ""): Trainee(make_vec_env(OURS, count), setting),
        (OURS, more, ""): Trainee(make_vec_env(OURS, more), setting),
        (OURS, more, "as shipped"): Trainee(make_vec_env(OURS, more), {**setting, **shipped}),
        (MUJOCO, count, ""): Trainee(peers_vec_env(MUJOCO, count), setting),
    }
    plays = measure.take_turns({name: trainee.play for name, trainee in trainees.items()}, rounds)
    rates = {name: [rate for rate, _ in pairs] for name, pairs in plays.items()}
    rows = [
        (*name, f"`{trainee.label}`", *measure.spread(rates[name]),
         f"{median(share for _, share in plays[name]):.1%}")
        for name, trainee in trainees.items()
    ]  # fmt: skip
    head = ("trained on", "at once", "hyperparameters", "in", "steps/s", "lowest", "highest",
            "in the environments")  # fmt: skip
    listed, ours = (
        ", ".join(f"{name} {value}" for name, value in given.items())
        for given in (setting, shipped)
    )
    ratio = measure.ratio(rates[OURS, count, ""], rates[MUJOCO, count, ""])
    return (
        f"## Training\n\nPPO, {listed}, layers {LAYERS}, one thread of torch. As shipped: {ours}."
        f"\n\n{measure.table(head, rows)}\n\nRatio of the steps/s, {count} at once: {ratio}."
    )


PARTS = {
    "one": one, "many": many, "size": size, "worlds": worlds, "designs": designs, "start": start,
    "ppo": ppo,
}  # fmt: skip


def against(other: Path, rounds: int, quick: bool) -> str:
    """This tree beside another: steps/s and seconds of starting, in turns."""
    trees = {"here": Tree(Path(__file__).parents[1]), "there": Tree(other)}
    steps, counts = (200, (1, 4)) if quick else (4000, (1, 16, 256))
    rows: list[tuple[Any, ...]] = []

    def compare(what: str, found: dict[str, list[float]], form: str) -> None:
        cells = [format(median(found[name]), form) for name in trees]
        rows.append((what, *cells, measure.ratio(found["here"], found["there"])))

    try:
        for label, plays, number in (
            ("nothing compiled", {n: tree.first for n, tree in trees.items()}, 1 if quick else 3),
            ("compiled", {n: tree.later for n, tree in trees.items()}, rounds),
        ):
            found = measure.take_turns(plays, number, warm_up=False)
            for k, stage in enumerate(STAGES):
                column = {name: [times[k] for times in found[name]] for name in trees}
                compare(f"{label}: {stage}, s", column, ".3g")
            compare(f"{label}: all, s", {n: list(map(sum, found[n])) for n in trees}, ".3g")
        for count in counts:
            playing = {name: partial(tree.rate, count, steps) for name, tree in trees.items()}
            rates = measure.take_turns(playing, rounds, warm_up=False)
            compare(f"{count} at once, steps/s", rates, ",.0f")
    finally:
        for tree in trees.values():
            tree.close()
    return measure.table(("JansenWalker-v0", *trees, "here / there (by round)"), rows)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "logs/speed", rounds=ROUNDS)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART",
                        help=f"of {', '.join(PARTS)}; all without it")  # fmt: skip
    parser.add_argument("--against", type=Path, metavar="TREE",
                        help="compare with this checkout of another commit instead")  # fmt: skip
    found = measure.chosen(parser, arguments)
    rounds = 1 if found.quick else found.rounds
    head = f"{measure.machine()} Medians of {rounds} rounds in turns."
    if found.against is not None:
        compared = against(found.against, rounds, found.quick)
        measure.report(found.out / "against.md", "# Two commits", head, compared)
        return
    if {"one", "many", "size"} & {*found.only}:
        measure.require("mujoco", "Box2D")
    if "ppo" in found.only:
        measure.require("stable_baselines3", "mujoco")
    parts = []
    for name, part in PARTS.items():
        if name in found.only:
            print(f"{name} ...", file=sys.stderr, flush=True)
            parts.append(part(rounds, found.quick))
    measure.report(found.out / "speed.md", "# Speed", head, *parts)


if __name__ == "__main__":
    main()
