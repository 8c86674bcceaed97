"""Score policies side by side: ``python -m agents.evaluate --policy pid --policy constant``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np

from agents.arguments import count, mapping
from agents.figures import score_figure
from agents.files import write_json
from agents.gif import save_gif
from agents.pid import BASELINES, load_baseline
from agents.rollout import COMMANDS, Policy, make_env, run_episodes
from agents.scores import episode_table, markdown_table, summarise

FIRST_SEED = 40_000  # of the episodes scored: training, tuning and selection use others


def load(name: str, env: Any) -> Policy:
    """A policy by name (:data:`agents.pid.BASELINES`) or from a run's folder or model file.

    Raises:
        ValueError: neither.
    """
    if name in BASELINES:
        return load_baseline(name, env.unwrapped.torque_limit, env.unwrapped.control_dt)
    if not Path(name).exists():
        raise ValueError(
            f"policy is {name!r}, must be one of {BASELINES}, a run's folder or a model's zip file"
        )
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # more would change the last bits of the actions
    from agents.training import load_policy  # only now: torch is slow to import

    return load_policy(name)


def title(name: str) -> str:
    """How a policy is called in tables: a model by its run's folder."""
    path = Path(name)
    if name in BASELINES:
        return name
    folder = path if path.is_dir() else path.parent
    stem = "" if path.is_dir() or path.stem == "best_model" else f" {path.stem}"
    return f"{folder.parent.name}/{folder.name}{stem}"


def evaluate(
    policies: dict[str, Policy],
    env_id: str,
    env_kwargs: dict[str, Any],
    commands: tuple[float, ...] = COMMANDS,
    episodes: int = 10,
    seed: int = 0,
) -> dict[str, dict[str, Any]]:
    """Scores of each policy on the same episodes, all with starts of their own.

    Returns:
        For each policy :func:`agents.scores.summarise` and its raw episodes under ``"raw"``.
    """
    env: Any = make_env(env_id, env_kwargs)
    horizon = env.spec.max_episode_steps * env.unwrapped.control_dt
    weight = env.unwrapped.weight
    env.close()
    command = np.repeat(commands, episodes)
    seeds = FIRST_SEED + seed * len(command) + np.arange(len(command))
    scores = {}
    for name, policy in policies.items():
        run = run_episodes(policy, env_id, env_kwargs, command, seeds)
        scores[name] = {**summarise(run, horizon, weight, seed), "raw": episode_table(run)}
    return scores


def film(policy: Policy, env_id: str, env_kwargs: dict[str, Any], command: float, seed: int,
         path: str | Path, seconds: float = 6.0, every: int = 3) -> None:  # fmt: skip
    """A GIF of one episode at a commanded speed (m/s), one frame in ``every`` steps."""
    env: Any = make_env(env_id, env_kwargs, render_mode="rgb_array")
    observation, _ = env.reset(seed=seed, options={"speed_command": command})
    frames, state, start = [], None, True
    for step in range(round(seconds / env.unwrapped.control_dt)):
        if step % every == 0:
            frames.append(env.render())
        actions, state = policy.predict(observation[None], state, np.array([start]), True)
        start = False
        observation, _, terminated, truncated, _ = env.step(actions[0])
        if terminated or truncated:
            break
    save_gif(frames, path, fps=1.0 / (every * env.unwrapped.control_dt), width=480, colors=48)
    env.close()


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", action="append", required=True, metavar="NAME",
                        help="pid, pid-paper, constant, or a run's folder or model")  # fmt: skip
    parser.add_argument("--env", default="JansenWalker-v0", help="environment id")
    parser.add_argument("--env-kwargs", default="{}", type=mapping, metavar="YAML",
                        help="arguments of the environment, e.g. '{friction: 0.5}'")  # fmt: skip
    parser.add_argument("--commands", type=float, nargs="+", default=list(COMMANDS), metavar="V",
                        help="commanded speeds, m/s")  # fmt: skip
    parser.add_argument("--episodes", type=count, default=10, help="episodes per command")
    parser.add_argument("--seed", type=int, default=0, help="another number, other starts")
    parser.add_argument("--out", default="logs/evaluation", metavar="DIR",
                        help="where scores.json and scores.png go")  # fmt: skip
    parser.add_argument("--video", action="store_true", help="also a GIF of each policy")
    parser.add_argument("--video-command", type=float, default=0.3, help="its speed, m/s")
    args = parser.parse_args(arguments)
    env = make_env(args.env, args.env_kwargs)
    policies = {title(name): load(name, env) for name in args.policy}
    env.close()
    scores = evaluate(
        policies, args.env, args.env_kwargs, tuple(args.commands), args.episodes, args.seed
    )
    out = Path(args.out)
    write_json(out / "scores.json", scores)
    score_figure(scores, out / "scores.png")
    print(markdown_table(scores))
    print(f"\n{args.episodes} episodes at each of {args.commands} m/s, seed {args.seed}; "
          f"95% bootstrap intervals. Written: {out}/scores.json, {out}/scores.png")  # fmt: skip
    if args.video:
        for name, policy in policies.items():
            path = out / f"{name.replace('/', '_').replace(' ', '_')}.gif"
            film(policy, args.env, args.env_kwargs, args.video_command, args.seed, path)
            print(f"written: {path}")


if __name__ == "__main__":
    main()
