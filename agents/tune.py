"""Make the baselines' data, ``agents/data``: ``python -m agents.tune [pid] [constant] [profile]``.

For ``pid`` and ``constant`` the walking speed at constant crank speeds (with the paper's gains) and
at constant torques is measured; ``profile`` is searched for (:mod:`agents.profile_search`).
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
from agents import profile, profile_search
from agents.command_line import non_negative_int, positive_int
from agents.policy import Array
from agents.profile import Profile
from agents.rollout import make_env, run_episodes
from agents.trials import Outcome
from agents.walker_baselines import BASELINES, DATA, POLICIES
from jansen_env.files import write_json

ENV = "JansenWalker-v0"
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
SETTINGS = {"pid": CRANK_SPEEDS, "constant": TORQUES}
FIRST_SEED = 10_000  # apart from all others
HORIZON = 10.0  # s, the time limit of an episode


def measure(name: str, settings: Array, episodes: int) -> dict[str, Any]:
    """Walking speeds (m/s) of each crank speed ("pid") or torque ("constant"), as in the file."""
    env = make_env(ENV, {}).unwrapped
    each = np.repeat(settings, episodes)
    policy = POLICIES[name](lambda _: each, env)
    commands, seeds = np.full(len(each), 0.3), FIRST_SEED + np.arange(len(each)) % episodes
    run = run_episodes(policy, ENV, {}, commands, seeds, at_once=len(each))
    speeds = (run["distance"] / HORIZON).reshape(-1, episodes)
    return {"settings": settings.tolist(), "speeds": speeds.round(4).tolist()}


def versions() -> dict[str, str]:
    """Of what a search's numbers come from."""
    return {
        "jansen_env": jansen_env.__version__,
        **{name: version(name) for name in ("cma", "numba", "numpy")},
    }


def tune_maps(names: list[str], episodes: int, path: Path) -> None:
    """Measure some of :data:`SETTINGS`; the others stay in the file as they are."""
    found = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    found["command"] = f"python -m agents.tune {' '.join(names)} --episodes {episodes}"
    for name in tqdm(names, desc="walking speeds", unit="baseline"):
        found[name] = measure(name, SETTINGS[name], episodes)
    print(f"written: {write_json(path, found)}")


def tune_profile(seed: int, path: Path) -> None:
    """Search for the profile; what there is after each sweep is in the file."""
    sweeps = profile_search.SWEEPS
    made: dict[str, Any] = {
        "command": f"python -m agents.tune profile --seed {seed}",
        "versions": versions(),
        "columns": list(profile.columns(profile_search.HARMONICS)),
    }
    total = len(profile_search.COMMANDS) * sum(sweep.generations for sweep in sweeps)
    with tqdm(total=total, desc="profile", unit="generation") as bar:

        def progress(command: float, out: Outcome) -> None:
            bar.set_postfix_str(
                f"{command:g} m/s: return {out.returns.mean():.0f}, falls {out.fell.mean():.1%}"
            )
            bar.update()

        def save(found: Profile) -> None:
            made["commands"] = found.commands.tolist()
            made["numbers"] = found.numbers.round(5).tolist()
            write_json(path, made)

        profile_search.search_profile(
            profile_search.COMMANDS, sweeps, seed=seed, progress=progress, save=save
        )
    print(f"written: {path}")


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("baselines", nargs="*", metavar="NAME", help=f"of {', '.join(BASELINES)}; default: all")
    add("--episodes", type=positive_int, default=6, help="per crank speed and torque measured")
    add("--seed", type=non_negative_int, default=0, help="of the search")
    add("--out", type=Path, default=DATA.parent, metavar="DIR", help="folder to write to")
    args = parser.parse_args(arguments)
    names = args.baselines or list(BASELINES)
    for name in names:
        if name not in BASELINES:
            parser.error(f"baseline is {name!r}, must be one of {list(BASELINES)}")
    maps = [name for name in SETTINGS if name in names]
    if maps:
        tune_maps(maps, args.episodes, args.out / DATA.name)
    if "profile" in names:
        tune_profile(args.seed, args.out / profile.DATA.name)


if __name__ == "__main__":
    main()
