"""Score policies side by side: ``python -m agents.evaluate --policy pid --policy constant``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from agents.command_line import mapping, non_negative_int, positive_int
from agents.evaluation import evaluate, labels, load_named
from agents.metrics import score_table
from agents.plots import plot_scores
from agents.policy import Policy
from agents.rollout import make_env
from agents.tasks import TASKS, find_task
from agents.video import record_video
from jansen_env.files import write_json
from jansen_env.plants.make import PLANTS


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line; what does not go together is refused."""
    named = "; ".join(f"{env_id}: {', '.join(task.baselines)}" for env_id, task in TASKS.items())
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("--policy", action="append", required=True, metavar="NAME",
        help=f"a baseline ({named}), or a run's folder or model")  # fmt: skip
    add("--env", default="JansenWalker-v0", choices=sorted(TASKS),
        help="environment id; default: JansenWalker-v0")  # fmt: skip
    add("--env-kwargs", default="{}", type=mapping, metavar="YAML",
        help="arguments of the environment, e.g. '{friction: 0.5}'")  # fmt: skip
    add("--plant", action="append", default=[], choices=sorted(PLANTS),
        help="of JansenWalker-v0; given again, side by side; default: projection")  # fmt: skip
    add("--commands", type=float, nargs="+", metavar="V",
        help="commanded speeds; default: the task's grid")  # fmt: skip
    add("--episodes", type=positive_int, default=10, help="episodes per command")
    add("--seed", type=non_negative_int, default=0, help="another number, other starts")
    add("--out", default="logs/evaluation", metavar="DIR",
        help="where scores.json and scores.png go")  # fmt: skip
    add("--video", nargs="?", const="gif", choices=("gif", "mp4"),
        help="also a video of each policy; default: gif")  # fmt: skip
    add("--video-command", type=float, metavar="V",
        help="its speed; default: from the middle of the task's grid")  # fmt: skip
    args = parser.parse_args(arguments)
    if args.plant and args.env != "JansenWalker-v0":
        parser.error(f"--plant is {args.plant}, but {args.env} has one plant only")
    if "speed_command" in args.env_kwargs:
        parser.error("speed_command in --env-kwargs has no effect here, must be in --commands")
    args.error = parser.error
    return args


def load_all(
    args: argparse.Namespace, commands: list[float]
) -> list[tuple[dict[str, Policy], dict[str, Any]]]:
    """For each plant the policies by label, and the environment's arguments.

    Raises:
        ValueError: a policy, an argument or a commanded speed is not allowed.
    """
    names = labels(args.policy)
    loaded = []
    for plant in dict.fromkeys(args.plant) or [None]:
        env_kwargs = args.env_kwargs if plant is None else {**args.env_kwargs, "plant": plant}
        suffix = "" if plant is None else f" on {plant}"
        env = make_env(args.env, env_kwargs)
        policies = {
            own + suffix: load_named(name, env)
            for own, name in zip(names, args.policy, strict=True)
        }
        for command in commands:
            env.reset(options={"speed_command": command})
        env.close()
        loaded.append((policies, env_kwargs))
    return loaded


def main(arguments: list[str] | None = None) -> None:
    """Score, draw, print; writes nothing before all that is asked for is known to be good."""
    args = parse(arguments)
    task, out = find_task(args.env), Path(args.out)
    commands = args.commands or list(task.commands)
    shown = args.video_command
    if shown is None:
        shown = task.commands[(len(task.commands) - 1) // 2]
    try:
        loaded = load_all(args, [*commands, shown])
        out.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        args.error(str(error))
    scores: dict[str, dict[str, Any]] = {}
    for policies, env_kwargs in loaded:
        scores |= evaluate(
            policies, args.env, env_kwargs, tuple(commands), args.episodes, args.seed
        )
    write_json(out / "scores.json", scores)
    plot_scores(task, scores, out / "scores.png")
    print(score_table(task.metrics, scores))
    print(f"\n{args.episodes} episodes at each of {commands} {task.command_unit}, "
          f"seed {args.seed}; 95% bootstrap intervals. "
          f"Written: {out}/scores.json, {out}/scores.png")  # fmt: skip
    if args.video is None:
        return
    for policies, env_kwargs in loaded:
        for name, policy in policies.items():
            path = out / f"{name.replace('/', '_').replace(' ', '_')}.{args.video}"
            record_video(policy, args.env, env_kwargs, shown, args.seed, path)
            print(f"written: {path}")


if __name__ == "__main__":
    main()
