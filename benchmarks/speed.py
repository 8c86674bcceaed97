"""Speed of the environments: one, many, harder ones, in PPO.

    python -m benchmarks.speed [--only PART ...] [--rounds 7] [--out logs/speed] [--quick]

Writes ``speed.md``.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from statistics import median
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar, cast

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box

from benchmarks import measure, walks
from jansen_env import ROBOTS, Robot, paper_robot
from jansen_env.cores import available_cores
from jansen_env.terrain.generators import make_generator

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

OURS, MUJOCO, BOX2D = "JansenWalker-v0", "Walker2d-v5", "BipedalWalker-v3"
FLAT, ROUGH, REAL = f"{OURS}, flat", f"{OURS}, rough", f"{OURS}, motor, bearings and feet"
SILENT, ONE_THREAD = "no information requested", "the same on one thread"
SEGMENTS = 100  # of the rough ground
AT_ONCE, LEVEL = 256, 3  # robots of each preset; of the rough ground that is exchanged
SAME, OTHER = "one rough ground for all episodes", "a new rough ground at each reset"
HARDCORE, BUILT = "JansenWalkerHardcore-v0", "the built robot, flat"
ROUNDS = 7
FEWEST, MOST = 16, 5000  # vector steps of a round
LIMITS = 250, 750  # steps of an episode of a batch, differing by robot; 500 in the mean
ENVIRONMENTS, ROLLOUTS = 64, 5  # of PPO, side by side; of a round, each with its update
SETTING: dict[str, Any] = {"n_steps": 64, "batch_size": 1024, "n_epochs": 6}
LAYERS = (64, 64)
NEVER = 10**9  # updates between two lines of a log

VectorEnv: TypeAlias = "gym.vector.VectorEnv[Any, Any, Any]"
P = ParamSpec("P")
K = TypeVar("K")
T = TypeVar("T")


class Single:
    """One environment and the random actions of a round; ``resets``: of the last round."""

    def __init__(self, env_id: str, steps: int, **arguments: Any) -> None:
        self.env = gym.make(env_id, **arguments)
        self.env.action_space.seed(0)
        self.resets = 0
        self.actions = [self.env.action_space.sample() for _ in range(steps)]

    def play(self) -> float:
        """Take all actions from the same start, resetting when an episode ends; steps/s."""
        env, resets = self.env, 0
        env.reset(seed=0)
        start = time.perf_counter()
        for action in self.actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
                resets += 1
        spent = time.perf_counter() - start
        self.resets = resets
        return len(self.actions) / spent

    @property
    def step_duration(self) -> float:
        """Simulated time of a step, s."""
        return 1.0 / float(self.env.metadata["render_fps"])


class Many:
    """A vector environment, reset, and random actions; each round goes on where the last ended."""

    def __init__(
        self, venv: gym.vector.VectorEnv[Any, Any, Any], count: int, space: Box, steps: int
    ) -> None:
        self.venv, self.count = venv, count
        shape = steps, count, *space.shape
        drawn = np.random.default_rng(0).uniform(space.low, space.high, shape)
        self.actions = list(drawn.astype(space.low.dtype))

    def play(self) -> float:
        """Take all actions; environment steps/s, in which a reset counts as a step."""
        start = time.perf_counter()
        for action in self.actions:
            self.venv.step(action)
        return self.count * len(self.actions) / (time.perf_counter() - start)


def robots(count: int, robot_steps: int, env_id: str = OURS, **arguments: Any) -> Many:
    """``gym.make_vec``'s robots, whose episodes end as evenly spread in time as in a long run."""
    first, last = LIMITS
    limits = [first + round((last - first) * (i + 0.5) / count) for i in range(count)]
    venv = gym.make_vec(env_id, num_envs=count, max_episode_steps=limits, **arguments)
    venv.reset(seed=0)
    steps = min(max(FEWEST, robot_steps // count), MOST)
    many = Many(venv, count, cast(Box, venv.single_action_space), steps)
    for number in range(first):
        venv.step(many.actions[number % len(many.actions)])
    return many


def rate_table(names: Iterable[str], rates: Mapping[K, list[float]]) -> str:
    """Steps/s by contestant; a contestant's key is one cell or a tuple of cells."""
    rows = [(*(key if isinstance(key, tuple) else (key,)), *measure.spread(series))
            for key, series in rates.items()]  # fmt: skip
    return measure.table((*names, "steps/s", "lowest", "highest"), rows)


def ratio_table(rates: Mapping[K, list[float]], pairs: Mapping[str, tuple[K, K]]) -> str:
    """Ratios of steps/s by label, each of two contestants."""
    rows = [(label, *measure.ratio(rates[a], rates[b])) for label, (a, b) in pairs.items()]
    return measure.table(
        ("ratio of steps/s", "medians", "lowest round", "highest round"),
        [(label, *(f"{value:.2f}" for value in values)) for label, *values in rows],
    )


def single(rounds: int, quick: bool) -> str:
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
    rows = [
        (name, *measure.spread(rates[name]), player.resets, f"{1e3 * player.step_duration:g}",
         f"{median(rates[name]) * player.step_duration:,.0f}")
        for name, player in players.items()
    ]  # fmt: skip
    head = ("environment", "steps/s", "lowest", "highest", "resets", "ms/step", "simulated s/s")
    pairs = {f"{a} / {b}": (a, b) for a in (FLAT, ROUGH) for b in (MUJOCO, BOX2D)}
    pairs[f"{REAL} / {FLAT}"] = REAL, FLAT
    tables = measure.table(head, rows), ratio_table(rates, pairs)
    return "\n\n".join(["## One environment", *tables])


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
    pairs: dict[str, tuple[tuple[str, int], tuple[str, int]]] = {
        f"{compared} robots / {peer}": (("flat", compared), (peer, n))
        for peer, n in players if MUJOCO in peer
    }  # fmt: skip
    cores = f"{compared} robots on {available_cores()} cores / on one thread"
    pairs[cores] = (SILENT, compared), (ONE_THREAD, compared)
    real = "motor, bearings, feet"
    pairs[f"{compared} with {real} / flat"] = (real, compared), ("flat", compared)
    tables = rate_table(("environments", "at once"), rates), ratio_table(rates, pairs)
    return "\n\n".join(["## Many environments", *tables])


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
    return Many(cast(VectorEnv, venv), count, venv.action_space, steps)


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
    pairs = {f"{name} / flat": (name, "flat") for name in rates if name not in ("flat", BUILT)}
    pairs |= {f"{a} / {b}": (a, b) for a, b in ((OTHER, SAME), (HARDCORE, BUILT))}
    tables = rate_table((f"{AT_ONCE} robots",), rates), ratio_table(rates, pairs)
    return "\n\n".join(["## Harder environments", *tables])


class Trainee:
    """PPO with some arguments, and the vector environments that it trains in."""

    def __init__(self, venv: VecEnv, setting: dict[str, Any]) -> None:
        from stable_baselines3 import PPO

        self.inside = 0.0  # s spent in the environments
        for name in ("reset", "step_async", "step_wait"):
            setattr(venv, name, self._timed(getattr(venv, name)))
        self.steps = ROLLOUTS * setting["n_steps"] * venv.num_envs
        self.model = PPO("MlpPolicy", venv, policy_kwargs={"net_arch": list(LAYERS)}, seed=0,
                         device="cpu", **setting)  # fmt: skip

    def _timed(self, call: Callable[P, T]) -> Callable[P, T]:
        def timed(*args: P.args, **kwargs: P.kwargs) -> T:
            start = time.perf_counter()
            try:
                return call(*args, **kwargs)
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
    the same hyperparameters.
    """
    import torch
    from stable_baselines3.common.env_util import make_vec_env as peers_vec_env

    from jansen_env.sb3 import make_vec_env

    count, setting = ENVIRONMENTS, SETTING
    if quick:
        count, setting = 4, {"n_steps": 8, "batch_size": 16, "n_epochs": 1}
    torch.set_num_threads(1)  # these networks are small, more threads cost more than they bring
    trainees = {
        (OURS, count): Trainee(make_vec_env(OURS, count), setting),
        (OURS, 4 * count): Trainee(make_vec_env(OURS, 4 * count), setting),
        (MUJOCO, count): Trainee(peers_vec_env(MUJOCO, count), setting),
    }
    plays = measure.take_turns({name: trainee.play for name, trainee in trainees.items()}, rounds)
    rows = [
        (*name, *measure.spread([rate for rate, _ in pairs]),
         f"{median(share for _, share in pairs):.1%}")
        for name, pairs in plays.items()
    ]  # fmt: skip
    head = ("trained on", "at once", "steps/s", "lowest", "highest", "in the environments")
    listed = ", ".join(f"{name} {value}" for name, value in setting.items())
    return (
        f"## Training\n\nPPO, {listed}, layers {LAYERS}, one thread of torch.\n\n"
        f"{measure.table(head, rows)}"
    )


PARTS = {"one": single, "many": many, "worlds": worlds, "ppo": ppo}


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "logs/speed", rounds=ROUNDS)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART",
                        help=f"of {', '.join(PARTS)}; all without it")  # fmt: skip
    args = measure.parse(parser, arguments)
    rounds = 1 if args.quick else args.rounds
    head = f"{measure.machine()} Medians of {rounds} rounds in turns."
    if {"one", "many"} & {*args.only}:
        measure.require("mujoco", "Box2D")
    if "ppo" in args.only:
        measure.require("stable_baselines3", "mujoco")
    parts = []
    for name, part in PARTS.items():
        if name in args.only:
            print(f"{name} ...", file=sys.stderr, flush=True)
            parts.append(part(rounds, args.quick))
    measure.report(args.out / "speed.md", "# Speed", head, *parts)


if __name__ == "__main__":
    main()
