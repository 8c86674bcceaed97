"""Make the baselines' data: ``python -m agents.tune [pid] [constant] [profile]``.

For ``pid`` and ``constant`` walking speeds are measured on the robot of ``--env``; ``profile`` is
searched for on it (:mod:`agents.tuning.profile_search`).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import numpy as np

import jansen_env
from agents.tuning import profile_search
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import Array, Controlled
from jansen_env.checks import listed
from jansen_env.commands.flags import Parser, non_negative_int, positive_int
from jansen_env.files import write_json
from jansen_env.robot import ROBOTS
from jansen_env.scoring.benchmarks import BENCHMARKS
from jansen_env.scoring.metrics import Episodes
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking import profile
from jansen_env.tasks.walking.walker_baselines import (
    BASELINES,
    DATA,
    constant_torque,
    nearest_setting,
    tuned_for,
    walking_pid,
)

ENV = "JansenWalker-v0"
FLAT = (ENV, "JansenWalkerBuilt-v0")  # harder worlds take the numbers of their robot
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
PAPER = (10.0, 1.0, 1.0)  # kp, ki, kd of the paper's PID
GAINS = (PAPER, *((kp, ki, kd) for kp in (1.0, 2.0, 3.0, 5.0, 10.0) for ki in (0.5, 2.0)
                  for kd in (0.2, 0.5, 1.0)))  # fmt: skip
FIRST_SEED = 10_000  # apart from all others
HORIZON = 10.0  # s, the time limit of an episode


def measure(
    name: str, settings: Array, episodes: int, env_id: str = ENV,
    gains: tuple[float, ...] = PAPER, **env_kwargs: object,
) -> dict[str, list[Any]]:  # fmt: skip
    """Measure walking speeds, m/s, of each crank speed ("pid") or torque ("constant")."""
    env = cast("Controlled", make_env(env_id, env_kwargs).unwrapped)
    each = np.repeat(settings, episodes)
    commands, seeds = np.full(len(each), 0.3), FIRST_SEED + np.arange(len(each)) % episodes
    policy = (walking_pid(lambda _: each, env, PID(*gains)) if name == "pid"
              else constant_torque(lambda _: each, env))  # fmt: skip
    run = run_episodes(policy, env_id, env_kwargs, commands, seeds, at_once=len(each))
    speeds = (run["distance"] / HORIZON).reshape(-1, episodes)
    return {"settings": settings.tolist(), "speeds": speeds.round(4).tolist()}


def measure_pid(
    episodes: int, env_id: str, gains: Sequence[tuple[float, ...]],
    settings: Array | None = None, **env_kwargs: object,
) -> dict[str, list[Any]]:  # fmt: skip
    """Measure the PID at crank speeds (rad/s), default :data:`CRANK_SPEEDS`, with those ``gains``
    whose mean return over the benchmark's commands is best, on other starts."""
    env = cast("Controlled", make_env(env_id, env_kwargs).unwrapped)
    commands = np.repeat(BENCHMARKS[env_id].commands, episodes)
    seeds = FIRST_SEED + episodes + np.arange(len(commands)) % episodes
    speeds = CRANK_SPEEDS if settings is None else settings
    best, made = -np.inf, {}
    for tried in gains:
        measured = measure("pid", speeds, episodes, env_id, tried, **env_kwargs)
        setting = nearest_setting(np.array(measured["settings"]), np.array(measured["speeds"]))
        policy = walking_pid(setting, env, PID(*tried))
        mean = run_episodes(policy, env_id, env_kwargs, commands, seeds)["returns"].mean()
        print(f"gains {tried}: return {mean:.1f}", flush=True)
        if mean > best:
            best, made = mean, {"gains": list(tried), **measured}
    return made


def save_design(path: Path, env_id: str, made: dict[str, Any]) -> None:
    """Write the numbers of the design of an environment's robot; those of others stay."""
    env: Any = make_env(env_id, {}).unwrapped
    design = tuned_for(env.robot, ROBOTS)
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    write_json(path, {**kept, design: {**kept.get(design, {}), **made}})


def tune_profile(seed: int, path: Path, env_id: str, effort: float) -> None:
    """Search for the profile, with ``effort`` times the generations; it is saved by sweep."""
    sweeps = [
        sweep._replace(generations=max(1, round(effort * sweep.generations)))
        for sweep in profile_search.SWEEPS
    ]
    commands = profile_search.COMMANDS
    made = {
        "command": f"python -m agents.tune profile --env {env_id} --seed {seed} "
        f"--effort {effort:g}",
        "versions": {name: version(name) for name in ("cma", "numpy")}
        | {"jansen_env": jansen_env.__version__},
        "columns": list(profile.number_names(profile_search.HARMONICS)),
    }

    def progress(command: float, run: Episodes) -> None:
        returns, falls = run["returns"].mean(), run["fell"].mean()
        print(f"{command:g} m/s: return {returns:.0f}, falls {falls:.1%}", flush=True)

    for searched in profile_search.search_profile(
        commands, sweeps, seed=seed, progress=progress, env_id=env_id
    ):
        numbers = searched.numbers.round(5).tolist()
        save_design(
            path, env_id, {**made, "commands": searched.commands.tolist(), "numbers": numbers}
        )


def main(arguments: list[str] | None = None) -> None:
    """Measure and search for the named baselines' numbers."""
    parser = Parser(
        "python -m agents.tune",
        "Make the baselines' data.",
        "python -m agents.tune pid constant",
        "python -m agents.tune profile",
    )
    add = parser.add_argument
    add("baselines", nargs="*", metavar="NAME", help=f"of {', '.join(BASELINES)}; default: all")
    add("--env", default=ENV, choices=FLAT, help="whose robot walks; default: %(default)s")
    add("--episodes", type=positive_int, default=6, help="per crank speed and torque measured")
    add("--seed", type=non_negative_int, default=0, help="of the search")
    add("--effort", type=float, default=1.0, help="share of the search's generations")
    add("--out", type=Path, default=DATA.parent, metavar="DIR", help="folder to write to")
    args = parser.parse_args(arguments)
    if not 0.0 < args.effort <= 100.0:
        parser.error(f"--effort is {args.effort}, must be above 0 and at most 100")
    known = list(BENCHMARKS[args.env].baselines)
    for name in args.baselines or known:
        if name not in known:
            parser.error(f"baseline is {name!r}, must be one of {listed(known, name)}")
    for name in args.baselines or known:
        path = args.out / (profile.DATA if name == "profile" else DATA).name
        if name == "profile":
            tune_profile(args.seed, path, args.env, args.effort)
        elif name in ("pid", "constant"):
            command = f"python -m agents.tune {name} --env {args.env} --episodes {args.episodes}"
            gains = (PAPER,) if args.env == ENV else GAINS
            made = (measure_pid(args.episodes, args.env, gains) if name == "pid"
                    else measure(name, TORQUES, args.episodes, args.env))  # fmt: skip
            save_design(path, args.env, {name: {"command": command, **made}})
        print(f"written: {path}")


if __name__ == "__main__":
    main()
