"""Score policies side by side: ``python -m agents.evaluate --policy pid --policy constant``."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents import robustness
from agents.command_line import parse_policies, policy_parser, positive_int
from agents.plots import plot_scores
from agents.video import FRAME_TIME, record_video
from jansen_env.baselines.policy import Policy
from jansen_env.baselines.profile import load_profile
from jansen_env.files import write_json
from jansen_env.policies import pretrained
from jansen_env.scoring.benchmarks import WALKERS, find_benchmark
from jansen_env.scoring.metrics import INTERVALS, pooled, score_table, summarise
from jansen_env.scoring.rollout import draw_episodes, make_env, run_episodes

FIRST_SEED = 40_000  # of scored episodes; training, tuning and selection use others
ALIASES = {"pid-paper": "pid", "pretrained": f"pretrained:{pretrained.DEFAULT}"}
KINDS = tuple(suffix.removeprefix(".") for suffix in FRAME_TIME)  # of video
SHIPPED = "pretrained:"  # before the name of a policy that comes with the package
SEARCHED = "profile:"  # before the file of a profile that a search has found

Scores = dict[str, dict[str, Any]]
"""Summary of :func:`evaluate` by policy; a run's own policy comes last."""


def load_named(name: str, env: Any) -> Policy:
    """Load a policy for ``env``: a baseline, ``"pretrained"`` or ``"pretrained:NAME"``, a searched
    profile ``"profile:FILE"``, or that of a run's folder or of the file of a model or policy; a
    ValueError where it does not fit."""
    env_id, own, path = env.spec.id, ALIASES.get(name, name), Path(name)
    baselines = find_benchmark(env_id).baselines
    if own in baselines:
        return baselines[own](env.unwrapped)
    if own.startswith(SHIPPED):
        path = pretrained.shipped(env_id, own.removeprefix(SHIPPED))
    elif own.startswith(SEARCHED):
        return load_profile(own.removeprefix(SEARCHED), "found").policy(env.unwrapped)
    elif not path.exists():
        raise ValueError(
            f"policy is {name!r}, must be one of {[*baselines, 'pretrained']}, a run's folder, a "
            "model's zip file or a policy's json file"
        )
    if path.suffix == ".json":
        packed = pretrained.load_file(path)
        try:
            return packed.on(env)
        except ValueError as error:
            raise ValueError(f"policy {name!r} does not fit {env_id}: {error}") from None
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # more would change the last bits of the actions
    from agents.training.models import load_policy  # only now: torch is slow to import

    policy: Any = load_policy(name)
    for space in ("observation_space", "action_space"):
        trained, needed = getattr(policy, space), getattr(env, space)
        if trained.shape != needed.shape:
            raise ValueError(f"policy {name!r} has an {space} of shape {trained.shape}, must be "
                             f"{needed.shape} for {env_id}")  # fmt: skip
    return policy


def model_file(name: str) -> Path | None:
    """Return the file of a policy; None for a baseline."""
    path = Path(name).resolve()
    if not path.exists():
        return None
    return path / "best_model.zip" if path.is_dir() else path


def label(name: str) -> str:
    """Return a policy's name in tables; a model or profile has that of its folder."""
    if name.startswith(SEARCHED):
        return "/".join(Path(name.removeprefix(SEARCHED)).resolve().parts[-3:-1])
    file = model_file(name)
    if file is None:
        return name
    stem = "" if file.stem == "best_model" else f" {file.stem}"
    return f"{file.parent.parent.name}/{file.parent.name}{stem}"


def labels(names: list[str]) -> list[str]:
    """Return :func:`label` of each policy, or the given names where two would share one; a
    ValueError where a policy is given twice."""
    policies = [model_file(name) or ALIASES.get(name, name) for name in names]
    for policy, name in zip(policies, names, strict=True):
        if (times := policies.count(policy)) > 1:
            raise ValueError(f"policy {name!r} is given {times} times, must be once")
    short = [label(name) for name in names]
    return [name if short.count(own) > 1 else own for name, own in zip(names, short, strict=True)]


def evaluate(
    policies: dict[str, Policy], env_id: str, env_kwargs: dict[str, Any],
    commands: Sequence[float] | None = None, episodes: int = 10, seed: int = 0,
    drawn: bool = False,
) -> Scores:  # fmt: skip
    """Score policies, by name, on the same episodes, each with a different start.

    Args:
        commands: speeds or goals; None for the benchmark's own grid. drawn: whether they are drawn
            from the environment's whole range instead.
        episodes: per command, or of ``drawn`` ones in all. seed: of commands and starts.

    Returns:
        For each policy :func:`jansen_env.scoring.metrics.summarise`, or with ``drawn``
        :func:`jansen_env.scoring.metrics.pooled`, and its episodes under ``"raw"``.
    """
    benchmark, env, scores = find_benchmark(env_id), make_env(env_id, env_kwargs), {}
    if drawn:
        command, seeds = draw_episodes(env, episodes, seed)
    else:
        command = np.repeat(benchmark.commands if commands is None else commands, episodes)
        seeds = FIRST_SEED + seed * len(command) + np.arange(len(command))
    summary = pooled if drawn else summarise
    for name, policy in policies.items():
        run = run_episodes(policy, env_id, env_kwargs, command, seeds)
        raw = {key: values.tolist() for key, values in run.items()}
        scores[name] = {**summary(benchmark.metrics, run, env, seed), "raw": raw}
    env.close()
    return scores


def score_run(folder: Path, config: dict[str, Any], episodes: int) -> Scores:
    """Score the best model in a run's folder and the baselines, with so many ``episodes`` per
    command; writes scores.json and scores.png. A ValueError names a damaged file."""
    from agents.training.runs import BEST, FINAL

    model = folder / BEST if (folder / BEST).is_file() else folder / FINAL
    env_id, env_kwargs = config["env"], config.get("env_kwargs", {})
    benchmark, env = find_benchmark(env_id), make_env(env_id, env_kwargs)
    policies = {name: load_named(name, env) for name in benchmark.baselines}
    policies[label(str(model))] = load_named(str(model), env)
    env.close()
    scores = evaluate(policies, env_id, env_kwargs, episodes=episodes)
    write_json(folder / "scores.json", scores)
    plot_scores(benchmark, scores, folder / "scores.png")
    return scores


def outcome(folder: Path, env_id: str, scores: Scores) -> str:
    """Return scores of :func:`score_run` as a Markdown table and a sentence."""
    from agents.training.runs import read_evaluations

    benchmark = find_benchmark(env_id)
    baseline, run = next(iter(benchmark.baselines)), list(scores)[-1]
    target, table = _mean_return(scores[baseline]), score_table(benchmark.metrics, scores)
    lines = [table, "brackets: 95 % intervals over episodes, not seeds"]
    ahead = [row for row in read_evaluations(folder) if row["return"] > target]
    if ahead and "seconds" in ahead[0]:
        steps, seconds = ahead[0]["steps"], ahead[0]["seconds"]
        lines.append(f"ahead of {baseline} at the evaluation after {steps:.0f} steps, "
                     f"{seconds:.0f} s from the start")  # fmt: skip
    lines.append(f"return: {_mean_return(scores[run]):.0f} against {target:.0f} of {baseline}; "
                 f"figure in {folder}")  # fmt: skip
    return "\n".join(lines)


def _mean_return(score: dict[str, Any]) -> float:
    return float(score["overall"]["return"][0])


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line; incompatible options are refused."""
    parser = policy_parser(__doc__, required=True, plants=True)
    add = parser.add_argument
    add("--commands", type=float, nargs="+", metavar="V",
        help="speeds or goals; default: the benchmark's grid")  # fmt: skip
    add("--episodes", type=positive_int, default=10,
        help="episodes per command, or with --robustness per condition; default: 10")  # fmt: skip
    add("--random-commands", type=positive_int, metavar="N",
        help="also N episodes with commands drawn from the environment's range")  # fmt: skip
    add("--robustness", action="store_true",
        help="scores over friction and foot stiffness with random commands, in place of those by "
        "command; a tenth of the episodes on 'rigid_body'")  # fmt: skip
    add("--out", default="logs/evaluation", metavar="DIR",
        help="folder of scores.json and scores.png, or of those of --robustness")  # fmt: skip
    add("--video", nargs="*", choices=KINDS, metavar="KIND",
        help="also videos of each policy, gif or mp4; default: both")  # fmt: skip
    add("--video-command", type=float, metavar="V",
        help="speed or goal of the videos; default: the grid's middle")  # fmt: skip
    args = parse_policies(parser, arguments, "--commands")
    if args.plant and args.env not in WALKERS:
        parser.error(f"--plant is {args.plant}, but {args.env} has one plant only")
    if args.robustness and args.env not in WALKERS:
        parser.error(f"--robustness needs one of {WALKERS}, but --env is {args.env}")
    if args.robustness and (args.commands or args.random_commands or args.video is not None):
        parser.error("--robustness goes without --commands, --random-commands and --video")
    benchmark = find_benchmark(args.env)
    args.commands = args.commands or list(benchmark.commands)
    if args.video_command is None:
        args.video_command = benchmark.middle
    return args


def load_all(
    args: argparse.Namespace, commands: Sequence[float] = ()
) -> list[tuple[dict[str, Policy], dict[str, Any]]]:
    """Return for each plant the policies by label, and the environment's arguments.

    Raises:
        ValueError: a policy, an argument or one of the commands is not allowed.
    """
    names = dict(zip(labels(args.policy), args.policy, strict=True))
    loaded = []
    for plant in dict.fromkeys(getattr(args, "plant", ())) or [None]:
        env_kwargs = args.env_kwargs if plant is None else {**args.env_kwargs, "plant": plant}
        suffix = "" if plant is None else f" on {plant}"
        env = make_env(args.env, env_kwargs)
        policies = {own + suffix: load_named(name, env) for own, name in names.items()}
        for command in commands:
            env.reset(options={find_benchmark(args.env).option: command})
        env.close()
        loaded.append((policies, env_kwargs))
    return loaded


def main(arguments: list[str] | None = None) -> None:
    """Score, draw, print; nothing is written before all arguments are checked."""
    args = parse(arguments)
    benchmark, out = find_benchmark(args.env), Path(args.out)
    try:
        loaded = load_all(args, (*args.commands, args.video_command))
        out.mkdir(parents=True, exist_ok=True)
        if args.robustness:
            print(robustness.report(loaded, args.env, args.episodes, args.seed, out))
            return
    except (OSError, ValueError) as error:
        args.error(str(error))
    scores: Scores = {}
    drawn: Scores = {}
    for policies, env_kwargs in loaded:
        scores |= evaluate(policies, args.env, env_kwargs, args.commands, args.episodes, args.seed)
        if count := args.random_commands:
            drawn |= evaluate(policies, args.env, env_kwargs, None, count, args.seed, drawn=True)
    both = {name: {**own, "drawn": drawn[name]} for name, own in scores.items() if drawn}
    write_json(out / "scores.json", both or scores)
    plot_scores(benchmark, scores, out / "scores.png")
    print(score_table(benchmark.metrics, scores))
    if drawn:
        print(f"\n{count} episodes with commands drawn from the environment's range:\n")
        print(score_table(benchmark.metrics, drawn))
    print(f"\n{args.episodes} episodes at each of {args.commands} {benchmark.command_unit}, "
          f"seed {args.seed}; {INTERVALS}. "
          f"Written: {out}/scores.json, {out}/scores.png")  # fmt: skip
    if args.video is None:
        return
    for policies, env_kwargs in loaded:
        for name, policy in policies.items():
            for kind in args.video or KINDS:
                path = out / f"{name.replace('/', '_').replace(' ', '_')}.{kind}"
                record_video(policy, args.env, env_kwargs, args.video_command, args.seed, path)
                print(f"written: {path}")


if __name__ == "__main__":
    main()
