"""Make the baselines' data, ``agents/data``: ``python -m agents.tune [pid] [constant] [profile]``.

For ``pid`` and ``constant`` the walking speed at constant crank speeds and at constant torques is
measured on the robot of ``--env``; the PID's gains are those of :data:`GAINS` that return most.
``profile`` is searched for on the same robot (:mod:`agents.tuning.profile_search`).
"""

from __future__ import annotations

import argparse
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import jansen_env
from agents.command_line import non_negative_int, positive_int
from agents.tuning import profile_search
from jansen_env.baselines import profile
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import Array, Policy
from jansen_env.baselines.profile import Profile
from jansen_env.baselines.walker_baselines import (
    BASELINES,
    DATA,
    Setting,
    constant_torque,
    nearest_setting,
    tuned_for,
    walking_pid,
)
from jansen_env.files import write_json
from jansen_env.robot import ROBOTS
from jansen_env.scoring.benchmarks import BENCHMARKS
from jansen_env.scoring.metrics import Episodes
from jansen_env.scoring.rollout import make_env, run_episodes

ENV = "JansenWalker-v0"
FLAT = (ENV, "JansenWalkerBuilt-v0")  # harder worlds take the numbers of their robot
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
SETTINGS = {"pid": CRANK_SPEEDS, "constant": TORQUES}
PAPER = (10.0, 1.0, 1.0)  # kp, ki, kd of the paper's PID
GAINS = (PAPER, *((kp, ki, kd) for kp in (1.0, 2.0, 3.0, 5.0, 10.0) for ki in (0.5, 2.0)
                  for kd in (0.2, 0.5, 1.0)))  # fmt: skip
FIRST_SEED = 10_000  # apart from all others
HORIZON = 10.0  # s, the time limit of an episode


def design_of(env_id: str) -> str:
    """Return the name of the built-in design that an environment's robot has the links of."""
    env: Any = make_env(env_id, {}).unwrapped
    return tuned_for(env.robot, ROBOTS)


def policy_of(name: str, setting: Setting, env: Any, gains: tuple[float, ...] = PAPER) -> Policy:
    """Return the baseline "pid" or "constant" with a setting for each command."""
    return (
        walking_pid(setting, env, PID(*gains)) if name == "pid" else constant_torque(setting, env)
    )


def measure(
    name: str,
    settings: Array,
    episodes: int,
    env_id: str = ENV,
    gains: tuple[float, ...] = PAPER,
) -> dict[str, Any]:
    """Walking speeds (m/s) of each crank speed ("pid") or torque ("constant"), as in the file."""
    env = make_env(env_id, {}).unwrapped
    each = np.repeat(settings, episodes)
    commands, seeds = np.full(len(each), 0.3), FIRST_SEED + np.arange(len(each)) % episodes
    policy = policy_of(name, lambda _: each, env, gains)
    run = run_episodes(policy, env_id, {}, commands, seeds, at_once=len(each))
    speeds = (run["distance"] / HORIZON).reshape(-1, episodes)
    return {"settings": settings.tolist(), "speeds": speeds.round(4).tolist()}


def measure_pid(episodes: int, env_id: str) -> dict[str, Any]:
    """Measure the PID: the paper's on the paper's robot, elsewhere with the best of :data:`GAINS`.

    Best is the mean return at the commands that policies are scored at, on other starts.
    """
    env, commands = make_env(env_id, {}).unwrapped, np.repeat(BENCHMARKS[env_id].commands, episodes)
    seeds = FIRST_SEED + episodes + np.arange(len(commands)) % episodes
    best, found = -np.inf, {}
    for gains in (PAPER,) if env_id == ENV else tqdm(GAINS, desc="gains", unit="PID"):
        tried = measure("pid", CRANK_SPEEDS, episodes, env_id, gains)
        setting = nearest_setting(np.array(tried["settings"]), np.array(tried["speeds"]))
        policy = policy_of("pid", setting, env, gains)
        worth = run_episodes(policy, env_id, {}, commands, seeds)["returns"].mean()
        if worth > best:
            best, found = worth, {"gains": list(gains), **tried}
    return found


def versions() -> dict[str, str]:
    """Return the versions of what a search's numbers come from."""
    return {
        "jansen_env": jansen_env.__version__,
        **{name: version(name) for name in ("cma", "numba", "numpy")},
    }


def save_design(path: Path, design: str, made: dict[str, Any]) -> Path:
    """Write a design's numbers; what the file has of others stays."""
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return write_json(path, {**kept, design: {**kept.get(design, {}), **made}})


def tune_maps(names: list[str], episodes: int, path: Path, env_id: str = ENV) -> None:
    """Measure some of :data:`SETTINGS` on an environment's robot."""
    made: dict[str, Any] = {}
    for name in tqdm(names, desc="walking speeds", unit="baseline"):
        command = f"python -m agents.tune {name} --env {env_id} --episodes {episodes}"
        made[name] = {"command": command} | (
            measure_pid(episodes, env_id) if name == "pid"
            else measure(name, SETTINGS[name], episodes, env_id)
        )  # fmt: skip
    print(f"written: {save_design(path, design_of(env_id), made)}")


def tune_profile(seed: int, path: Path, env_id: str = ENV, effort: float = 1.0) -> None:
    """Search for the profile; what there is after each sweep is in the file.

    ``effort``: by which the numbers of generations are multiplied.
    """
    sweeps = [
        sweep._replace(generations=max(1, round(effort * sweep.generations)))
        for sweep in profile_search.SWEEPS
    ]
    commands, design = profile_search.COMMANDS, design_of(env_id)
    made: dict[str, Any] = {
        "command": f"python -m agents.tune profile --env {env_id} --seed {seed} "
        f"--effort {effort:g}",
        "versions": versions(),
        "columns": list(profile.number_names(profile_search.HARMONICS)),
    }
    total = len(commands) * sum(sweep.generations for sweep in sweeps)
    with tqdm(total=total, desc="profile", unit="generation") as bar:

        def progress(command: float, run: Episodes) -> None:
            returns, falls = run["returns"].mean(), run["fell"].mean()
            bar.set_postfix_str(f"{command:g} m/s: return {returns:.0f}, falls {falls:.1%}")
            bar.update()

        def save(found: Profile) -> None:
            made["commands"] = found.commands.tolist()
            made["numbers"] = found.numbers.round(5).tolist()
            save_design(path, design, made)

        profile_search.search_profile(
            commands, sweeps, seed=seed, progress=progress, save=save, env_id=env_id
        )
    print(f"written: {path}")


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
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
    names = args.baselines or list(BENCHMARKS[args.env].baselines)
    for name in names:
        if name not in BENCHMARKS[args.env].baselines:
            known = list(BENCHMARKS[args.env].baselines)
            parser.error(f"baseline is {name!r}, must be one of {known} for {args.env}")
    maps = [name for name in SETTINGS if name in names]
    if maps:
        tune_maps(maps, args.episodes, args.out / DATA.name, args.env)
    if "profile" in names:
        tune_profile(args.seed, args.out / profile.DATA.name, args.env, args.effort)


if __name__ == "__main__":
    main()
