"""Take a policy along: ``python -m agents.export RUN --to onnx --to c`` writes it for onnxruntime,
as C99 source for a microcontroller or as the package's own two files, with a model card beside it.

What is written has been compared with the policy in PyTorch on 10,000 observations; where an action
differs by more than 1e-6 nothing is written.
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import torch
from safetensors.numpy import save

from agents import export_c
from agents.command_line import non_negative_int, positive_int
from agents.evaluate import ALIASES, SHIPPED, evaluate
from agents.export_check import (
    OPTIONS,
    Cases,
    actions_of,
    actions_of_c,
    compiler,
    largest_difference,
    make_cases,
)
from agents.model_card import Export, card
from agents.pack import TOLERANCE, from_run, in_float64
from agents.rollout import make_env
from agents.tasks import DEFAULT, TASKS, find_task
from agents.unpack import to_policy
from jansen_env import pretrained
from jansen_env.files import write_bytes
from jansen_env.pretrained import PretrainedPolicy

KINDS = ("onnx", "c", "safetensors")
CASES = 10_000  # observations on which is compared
NUMPY, ONNX, C, SINGLE, TORCH = (
    "NumPy, jansen_env.pretrained", "ONNX", "C in double", "C in float",
    "PyTorch itself in float32",
)  # fmt: skip


def read(run: str, env_id: str | None = None) -> tuple[PretrainedPolicy, str, bool]:
    """A policy, how it is called, and whether it comes with the package.

    Args:
        run: a run's folder, a model's zip file, a policy's json file, ``"pretrained"`` or
            ``"pretrained:NAME"``. env_id: of the last two; None for the default.

    Raises:
        ValueError: there is none, it is damaged, or it has a part that cannot be packed.
    """
    own = ALIASES.get(run, run)
    if own.startswith(SHIPPED):
        path = pretrained.shipped(env_id or DEFAULT, own.removeprefix(SHIPPED))
        return pretrained.load_file(path), path.stem, True
    if env_id is not None:
        raise ValueError(f"--env is {env_id}, but {run} says itself what it was trained on")
    if Path(run).suffix == ".json":
        return pretrained.load_file(run), Path(run).stem, False
    policy = from_run(run)
    return policy, policy.description["training"]["config"]["algo"], False


def default_name(env_id: str, own: str) -> str:
    """Such as jansen_walker_v0_ppo."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", f"{env_id}_{own}").lower()
    return re.sub(r"[^a-z0-9]+", "_", words).strip("_")[:63]


def export(
    run: str,
    kinds: tuple[str, ...],
    out: str | Path = "exports",
    name: str | None = None,
    env_id: str | None = None,
    episodes: int = 10,
    seed: int = 0,
    command: str = "python -m agents.export",
) -> tuple[list[Path], dict[str, float | None]]:
    """Write a policy and its model card into a folder.

    Args:
        run, env_id: see :func:`read`. kinds: of :data:`KINDS`. out: the folder.
        name: of the files, and of functions in C; None for that of environment and policy.
        episodes, seed: of the scores, as of :func:`agents.evaluate.evaluate`.
        command: what the card is to say of how it was written.

    Returns:
        The files, the card last; by how much actions differ at most from those of PyTorch in
        float64, by what computes them, None for what could not be run here.

    Raises:
        ValueError: as of :func:`read`; the name is none for C; or what was made does not act as the
            policy does. ModuleNotFoundError: onnx is asked for and not installed.
    """
    policy, own, shipped = read(run, env_id)
    name = export_c.check_name(default_name(policy.env_id, own) if name is None else name)
    find_task(policy.env_id)
    env = make_env(policy.env_id, policy.env_kwargs)
    policy.on(env)
    env.close()
    cases = make_cases(policy, CASES)
    expected = actions_of(in_float64(to_policy(policy)), cases)
    found = {"safetensors": _numpy, "onnx": _onnx, "c": _c}
    files: dict[str, bytes] = {}
    differences: dict[str, float | None] = {}
    for kind in kinds:
        made, actions = found[kind](policy, name, cases)
        files |= made
        for what, theirs in actions.items():
            difference = None if theirs is None else largest_difference(theirs, expected)
            if difference is not None and difference > TOLERANCE and what != SINGLE:
                raise ValueError(
                    f"actions of {what} differ by {difference:.2g} from PyTorch's, must be "
                    f"{TOLERANCE} at most: nothing was written"
                )
            differences[what] = difference
    differences[TORCH] = largest_difference(actions_of(to_policy(policy), cases), expected)
    scores = _scores(policy, name, episodes, seed)
    if "safetensors" in kinds:
        summary = {part: scores[name][part] for part in ("overall", "by_command")}
        files[f"{name}.json"] = _description(
            policy, {"episodes_per_command": episodes, "seed": seed, **summary}
        )
    told = Export(
        name, policy, run, shipped, command, files, kinds, differences, len(cases), scores,
        episodes, seed, cases[len(cases) // 4],
    )  # fmt: skip
    files[f"{name}.md"] = card(told).encode("utf-8")
    return [write_bytes(Path(out) / file, data) for file, data in files.items()], differences


def _onnx(policy: PretrainedPolicy, name: str, cases: Cases) -> tuple[dict[str, bytes], Any]:
    """The file, and its actions by onnx's reference implementation."""
    from onnx.reference import ReferenceEvaluator

    from agents.export_onnx import OnnxPolicy, build  # only where it is asked for: a package more

    model = build(policy, name)
    runner = OnnxPolicy(ReferenceEvaluator(model))
    return {f"{name}.onnx": model.SerializeToString()}, {ONNX: actions_of(runner, cases)}


def _c(policy: PretrainedPolicy, name: str, cases: Cases) -> tuple[dict[str, bytes], Any]:
    """The files, and their actions as this machine's compiler has them; None where it has none."""
    texts = export_c.sources(policy, name)
    files = {file: text.encode("ascii") for file, text in texts.items()}
    if compiler() is None:
        return files, {C: None, SINGLE: None}
    single = (*OPTIONS, f"-D{name.upper()}_SINGLE_PRECISION")
    return files, {
        C: actions_of_c(texts, name, cases),
        SINGLE: actions_of_c(texts, name, cases, single),
    }


def _numpy(policy: PretrainedPolicy, name: str, cases: Cases) -> tuple[dict[str, bytes], Any]:
    """The weights' file; the other one has the scores and comes later."""
    return {f"{name}.safetensors": save(policy.tensors)}, {NUMPY: actions_of(policy, cases)}


def _description(policy: PretrainedPolicy, scores: dict[str, Any]) -> bytes:
    """The json file's content."""
    weights = pretrained.checksum(save(policy.tensors))
    whole = {**policy.description, "scores": scores, "sha256": weights}
    return (json.dumps(whole, indent=1) + "\n").encode("utf-8")


def _scores(policy: PretrainedPolicy, name: str, episodes: int, seed: int) -> dict[str, Any]:
    """Of the policy under its name, and of the baselines on the same starts."""
    env = make_env(policy.env_id, policy.env_kwargs)
    baselines = find_task(policy.env_id).baselines
    policies: dict[str, Any] = {own: load(env.unwrapped) for own, load in baselines.items()}
    env.close()
    policies[name] = policy
    return evaluate(policies, policy.env_id, policy.env_kwargs, episodes=episodes, seed=seed)


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("run", metavar="RUN", help="a run's folder, a model's zip file with config.yml beside it, "
        "a policy's json file, 'pretrained' or 'pretrained:NAME'")  # fmt: skip
    add("--to", action="append", required=True, choices=KINDS,
        help="what to write; given again, several of them")  # fmt: skip
    add("--env", choices=sorted(TASKS), help=f"of 'pretrained'; default: {DEFAULT}")
    add("--out", default="exports", metavar="DIR", help="folder of the files; default: exports")
    add("--name", help="of the files and of functions in C; default: such as jansen_walker_v0_ppo")
    add("--episodes", type=positive_int, default=10,
        help="per command, of the scores in the model card; default: 10")  # fmt: skip
    add("--seed", type=non_negative_int, default=0, help="of the scores; default: 0")
    args = parser.parse_args(arguments)
    args.error = parser.error
    args.to = tuple(dict.fromkeys(args.to))
    if "onnx" in args.to and find_spec("onnx") is None:
        parser.error("--to onnx needs the package onnx, which the extra 'export' installs: "
                     'python -m pip install "jansen-env[export]", or in a checkout '
                     '-e ".[export]"')  # fmt: skip
    return args


def main(arguments: list[str] | None = None) -> None:
    """Export a policy, and say what was written and how well it agrees."""
    words = sys.argv[1:] if arguments is None else arguments
    args = parse(words)
    torch.set_num_threads(1)  # of a network this small more only wait for one another
    command = shlex.join(["python", "-m", "agents.export", *words])
    print(f"comparing on {CASES} observations, then scoring beside the baselines ...", flush=True)
    try:
        paths, differences = export(
            args.run, args.to, args.out, args.name, args.env, args.episodes, args.seed, command
        )
    except (OSError, ValueError) as error:
        args.error(str(error))
    for path in paths:
        print(f"written: {path} ({path.stat().st_size / 1000:.1f} kB)")
    for what, difference in differences.items():
        told = "not run: no C compiler here" if difference is None else f"{difference:.2g}"
        print(f"largest difference of an action to PyTorch's in float64, {what}: {told}")


if __name__ == "__main__":
    main()
