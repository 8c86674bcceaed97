"""Score policies side by side: ``python -m agents.evaluate --policy pid --policy constant``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np

from agents.arguments import count, mapping, steps
from agents.figures import score_figure
from agents.gif import save_gif
from agents.policy import Policy
from agents.rollout import make_env, run_episodes
from agents.scores import episode_table, markdown_table, summarise
from agents.tasks import TASKS, find_task
from jansen_env.files import write_json
from jansen_env.plants.make import PLANTS

FIRST_SEED = 40_000  # of the episodes scored: training, tuning and selection use others
FRAME_TIME = 0.06  # s, from one picture of a film to the next


def load(name: str, env: Any) -> Policy:
    """A policy for ``env`` by a baseline's name, or from a run's folder or model file.

    Raises:
        ValueError: neither, or a model that was trained on other observations or actions.
    """
    task = find_task(env.spec.id)
    if name in task.baselines:
        return task.load_baseline(name, env.unwrapped)
    if not Path(name).exists():
        raise ValueError(
            f"policy is {name!r}, must be one of {task.baselines}, a run's folder or a model's "
            "zip file"
        )
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # more would change the last bits of the actions
    from agents.models import load_policy  # only now: torch is slow to import

    policy: Any = load_policy(name)
    for space in ("observation_space", "action_space"):
        own, needed = getattr(policy, space), getattr(env, space)
        if own.shape != needed.shape:
            raise ValueError(
                f"policy {name!r} has an {space} of shape {own.shape}, must be {needed.shape} "
                f"for {env.spec.id}"
            )
    loaded: Policy = policy
    return loaded


def title(name: str) -> str:
    """How a policy is called in tables: a model by its run's folder."""
    path = Path(name)
    if not path.exists():  # a baseline
        return name
    folder = path if path.is_dir() else path.parent
    stem = "" if path.is_dir() or path.stem == "best_model" else f" {path.stem}"
    return f"{folder.parent.name}/{folder.name}{stem}"


def titles(names: list[str]) -> list[str]:
    """:func:`title` of each policy, and where two would share one, the names as they are given.

    Raises:
        ValueError: a policy is given twice.
    """
    files = [str(_model_file(name)) for name in names]
    for file, name in zip(files, names, strict=True):
        if files.count(file) > 1:
            raise ValueError(f"policy {name!r} is given {files.count(file)} times, must be once")
    found = [title(name) for name in names]
    return [name if found.count(own) > 1 else own for name, own in zip(names, found, strict=True)]


def _model_file(name: str) -> Path:
    """The file that a policy is in; of a baseline its name."""
    path = Path(name)
    if not path.exists():
        return path
    return (path / "best_model.zip" if path.is_dir() else path).resolve()


def evaluate(
    policies: dict[str, Policy],
    env_id: str,
    env_kwargs: dict[str, Any],
    commands: tuple[float, ...] | None = None,
    episodes: int = 10,
    seed: int = 0,
) -> dict[str, dict[str, Any]]:
    """Scores of each policy on the same episodes, all with starts of their own.

    Args:
        policies: by name. env_id, env_kwargs: of the environment.
        commands: commanded speeds; None for the task's own grid.
        episodes: per command. seed: another number, other starts.

    Returns:
        For each policy :func:`agents.scores.summarise` and its raw episodes under ``"raw"``.

    Raises:
        ValueError: no task is known for ``env_id``, or an argument out of range.
    """
    task = find_task(env_id)
    command = np.repeat(task.commands if commands is None else commands, episodes)
    seeds = FIRST_SEED + seed * len(command) + np.arange(len(command))
    env = make_env(env_id, env_kwargs)
    scores = {}
    for name, policy in policies.items():
        run = run_episodes(policy, env_id, env_kwargs, command, seeds)
        scores[name] = {**summarise(task, run, env, seed), "raw": episode_table(run)}
    env.close()
    return scores


def film(policy: Policy, env_id: str, env_kwargs: dict[str, Any], command: float, seed: int,
         path: str | Path, seconds: float = 6.0) -> None:  # fmt: skip
    """A GIF of one episode at a commanded speed, a picture every :data:`FRAME_TIME`."""
    env: Any = make_env(env_id, env_kwargs, render_mode="rgb_array")
    dt = env.unwrapped.control_dt
    every = max(1, round(FRAME_TIME / dt))
    observation, _ = env.reset(seed=seed, options={"speed_command": command})
    frames, state, start = [], None, True
    for step in range(round(seconds / dt)):
        if step % every == 0:
            frames.append(env.render())
        actions, state = policy.predict(observation[None], state, np.array([start]), True)
        start = False
        observation, _, terminated, truncated, _ = env.step(actions[0])
        if terminated or truncated:
            break
    save_gif(frames, path, fps=1.0 / (every * dt), width=480, colors=48)
    env.close()


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    named = "; ".join(f"{env_id}: {', '.join(task.baselines)}" for env_id, task in TASKS.items())
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", action="append", required=True, metavar="NAME",
                        help=f"a baseline ({named}), or a run's folder or model")  # fmt: skip
    parser.add_argument("--env", default="JansenWalker-v0", choices=sorted(TASKS),
                        help="environment id; default: JansenWalker-v0")  # fmt: skip
    parser.add_argument("--env-kwargs", default="{}", type=mapping, metavar="YAML",
                        help="arguments of the environment, e.g. '{friction: 0.5}'")  # fmt: skip
    parser.add_argument("--plant", action="append", default=[], choices=sorted(PLANTS),
                        help="plant of JansenWalker-v0; given again, side by side; "
                        "default: projection")  # fmt: skip
    parser.add_argument("--commands", type=float, nargs="+", metavar="V",
                        help="commanded speeds; default: the task's grid")  # fmt: skip
    parser.add_argument("--episodes", type=count, default=10, help="episodes per command")
    parser.add_argument("--seed", type=steps, default=0, help="another number, other starts")
    parser.add_argument("--out", default="logs/evaluation", metavar="DIR",
                        help="where scores.json and scores.png go")  # fmt: skip
    parser.add_argument("--video", action="store_true", help="also a GIF of each policy")
    parser.add_argument("--video-command", type=float, metavar="V",
                        help="its speed; default: from the middle of the task's grid")  # fmt: skip
    args = parser.parse_args(arguments)
    task = find_task(args.env)
    commands = args.commands or list(task.commands)
    if args.plant and args.env != "JansenWalker-v0":
        parser.error(f"--plant is {args.plant}, but {args.env} has one plant only")
    scored: list[tuple[dict[str, Policy], dict[str, Any]]] = []
    try:  # all of what is asked for before any of it is run
        names = titles(args.policy)
        for plant in dict.fromkeys(args.plant) or [None]:
            env_kwargs = args.env_kwargs if plant is None else {**args.env_kwargs, "plant": plant}
            suffix = "" if plant is None else f" on {plant}"
            env = make_env(args.env, env_kwargs)
            policies = {
                own + suffix: load(name, env) for own, name in zip(names, args.policy, strict=True)
            }
            for command in [*commands, args.video_command]:
                if command is not None:
                    env.reset(options={"speed_command": command})
            env.close()
            scored.append((policies, env_kwargs))
        out = Path(args.out)
        out.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    scores: dict[str, dict[str, Any]] = {}
    films: dict[str, tuple[Policy, dict[str, Any]]] = {}
    for policies, env_kwargs in scored:
        scores |= evaluate(
            policies, args.env, env_kwargs, tuple(commands), args.episodes, args.seed
        )
        films |= {name: (policy, env_kwargs) for name, policy in policies.items()}
    write_json(out / "scores.json", scores)
    score_figure(task, scores, out / "scores.png")
    print(markdown_table(task, scores))
    print(f"\n{args.episodes} episodes at each of {commands} {task.command_unit}, "
          f"seed {args.seed}; 95% bootstrap intervals. "
          f"Written: {out}/scores.json, {out}/scores.png")  # fmt: skip
    if args.video:
        middle = task.commands[(len(task.commands) - 1) // 2]
        command = middle if args.video_command is None else args.video_command
        for name, (policy, env_kwargs) in films.items():
            path = out / f"{name.replace('/', '_').replace(' ', '_')}.gif"
            film(policy, args.env, env_kwargs, command, args.seed, path)
            print(f"written: {path}")


if __name__ == "__main__":
    main()
