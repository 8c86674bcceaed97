"""Take a policy along: ``python -m agents.export RUN --to onnx --to c`` writes it for onnxruntime
and as C99 source for a microcontroller, with a model card beside it.

Exports are compared with the policy in PyTorch on 10,000 observations first. If an action differs
by more than 1e-6, nothing is written.
"""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from pathlib import Path
from typing import Any

import torch

from agents import need
from agents.export import agreement, c_source, onnx_model
from agents.export.model_card import card
from agents.pack import TOLERANCE, from_run, in_float64, to_policy
from jansen_env.commands.flags import Parser, non_negative_int, positive_int
from jansen_env.commands.flags import env_id as find_env_id
from jansen_env.commands.named_policies import ALIASES, SHIPPED
from jansen_env.files import write_bytes
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.scoring.benchmarks import DEFAULT, find_benchmark
from jansen_env.scoring.evaluation import evaluate
from jansen_env.scoring.rollout import make_env

KINDS = ("onnx", "c")
CASES = 10_000  # observations on which is compared
UNCHECKED = ("C in float", "PyTorch itself in float32")  # which are less exact, and say so


def read(run: str, env_id: str | None = None) -> tuple[PretrainedPolicy, str]:
    """Return the policy and the name of what :func:`export` is given."""
    own = ALIASES.get(run, run)
    if own.startswith(SHIPPED):
        path = pretrained.shipped(env_id or DEFAULT, own.removeprefix(SHIPPED))
        return pretrained.load_file(path), path.stem
    if env_id is not None:
        raise ValueError(f"--env is {env_id}, but {run} says itself what it was trained on")
    if Path(run).suffix == ".json":
        return pretrained.load_file(run), Path(run).stem
    policy = from_run(run)
    return policy, policy.description["training"]["config"]["algo"]


def export(
    run: str, kinds: tuple[str, ...], out: str | Path = "exports", name: str | None = None,
    env_id: str | None = None, episodes: int = 10, seed: int = 0,
    command: str = "python -m agents.export",
) -> tuple[list[Path], dict[str, float | None]]:  # fmt: skip
    """Write a policy and its model card into a folder.

    Args:
        run: a run's folder, a model's zip file, a policy's json file, ``"pretrained"`` or
            ``"pretrained:NAME"``. env_id: of the last two; None for the default.
        kinds: of :data:`KINDS`. out: the folder.
        name: of the files, and of functions in C; None for one such as jansen_walker_v0_ppo.
        episodes, seed: of the scores, as of :func:`jansen_env.scoring.evaluation.evaluate`.
        command: what the card is to say of how it was written.

    Returns:
        The files, the card last; by how much actions differ at most from those of PyTorch in
        float64, by what computes them, None for what could not be run here.

    Raises:
        ValueError: there is no such policy, it is damaged, or it has a part that cannot be packed;
            the name is none for C; or what was made does not act as the policy does.
    """
    policy, own = read(run, env_id)
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", f"{policy.env_id}_{own}").lower()
    default = re.sub(r"[^a-z0-9]+", "_", words).strip("_")[:63]
    name = c_source.check_name(default if name is None else name)
    env = make_env(policy.env_id, policy.env_kwargs)
    policy.on(env)
    baselines = find_benchmark(policy.env_id).baselines
    policies: dict[str, Any] = {key: load(env.unwrapped) for key, load in baselines.items()}
    env.close()
    cases = agreement.make_cases(policy, CASES)
    expected = agreement.actions_of(in_float64(to_policy(policy)), cases)
    files: dict[str, bytes] = {}
    actions: dict[str, Any] = {}
    for kind in kinds:
        made, found = {"onnx": _onnx, "c": _c}[kind](policy, name, cases)
        files, actions = files | made, actions | found
    actions[UNCHECKED[1]] = agreement.actions_of(to_policy(policy), cases)
    differences = {
        what: None if theirs is None else agreement.largest_difference(theirs, expected)
        for what, theirs in actions.items()
    }
    for what, difference in differences.items():
        if what not in UNCHECKED and (difference or 0.0) > TOLERANCE:
            raise ValueError(
                f"actions of {what} differ by {difference:.2g} from PyTorch's, must be {TOLERANCE} "
                "at most: nothing was written"
            )
    told = {
        "name": name, "run": run, "command": command, "onnx": "onnx" in kinds,
        "example": c_source.example(policy, name) if "c" in kinds else "",
        "differences": differences, "compared": len(cases), "observation": cases[len(cases) // 4],
        "scores": evaluate({name: policy, **policies}, policy.env_id, policy.env_kwargs,
                           episodes=episodes, seed=seed),
        "episodes": episodes, "seed": seed,
    }  # fmt: skip
    files[f"{name}.md"] = card(policy, files, told).encode("utf-8")
    return [write_bytes(Path(out) / file, data) for file, data in files.items()], differences


def _onnx(policy: PretrainedPolicy, name: str, cases: Any) -> tuple[dict[str, bytes], Any]:
    """Return the file, and its actions by onnx's reference implementation."""
    from onnx.reference import ReferenceEvaluator  # only where it is asked for: a package more

    model = onnx_model.build(policy, name)
    actions = onnx_model.actions_of(ReferenceEvaluator(model), cases)
    return {f"{name}.onnx": model.SerializeToString()}, {"ONNX": actions}


def _c(policy: PretrainedPolicy, name: str, cases: Any) -> tuple[dict[str, bytes], Any]:
    """Return the files, and their actions as this machine's compiler has them; None without one."""
    texts = c_source.sources(policy, name)
    single = (*agreement.OPTIONS, f"-D{name.upper()}_SINGLE_PRECISION")
    actions: dict[str, Any] = {"C in double": None, UNCHECKED[0]: None}
    if agreement.compiler() is not None:
        program = {**texts, "main.c": c_source.example(policy, name)}
        for what, options in zip(actions, (agreement.OPTIONS, single), strict=True):
            actions[what] = agreement.actions_of_c(program, name, cases, options)
    return {file: text.encode("ascii") for file, text in texts.items()}, actions


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = Parser("python -m agents.export", __doc__,
                    "python -m agents.export pretrained --to c",
                    "python -m agents.export logs/ppo/JansenWalkerBuilt-v0_1 --to onnx --out robot"
                    )  # fmt: skip
    add = parser.add_argument
    add("run", metavar="RUN", help="a run's folder, a model's zip file with config.yml beside it, "
        "a policy's json file, 'pretrained' or 'pretrained:NAME'")  # fmt: skip
    add("--to", action="append", required=True, choices=KINDS,
        help="what to write; given again, several of them")  # fmt: skip
    add("--env", type=find_env_id, metavar="ID", help=f"of 'pretrained'; default: {DEFAULT}")
    add("--out", default="exports", metavar="DIR", help="folder of the files; default: exports")
    add("--name", help="of the files and of functions in C; default: such as jansen_walker_v0_ppo")
    add("--episodes", type=positive_int, default=10,
        help="per command, of the scores in the model card; default: 10")  # fmt: skip
    add("--seed", type=non_negative_int, default=0, help="of the scores; default: 0")
    args = parser.parse_args(arguments)
    args.error, args.to = parser.error, tuple(dict.fromkeys(args.to))
    if "onnx" in args.to:
        need("export", *onnx_model.NEEDED, who="--to onnx")
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
