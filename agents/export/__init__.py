"""Take a policy along: ``python -m agents.export RUN --to onnx --to c`` writes it for onnxruntime
and as C99 source for a microcontroller, with a model card beside it.

Exports are compared with the policy in PyTorch on 10,000 observations first. If an action differs
by more than 1e-6, nothing is written.
"""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import torch

from agents import need
from agents.export import c_source, onnx_model
from agents.export.model_card import card
from agents.pack import TOLERANCE, from_run, in_float64, random_observations, to_policy
from jansen_env.baselines.policy import Array, Policy
from jansen_env.commands.flags import Parser, env_id, non_negative_int, positive_int
from jansen_env.commands.named_policies import ALIASES, SHIPPED
from jansen_env.files import write_bytes
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.scoring.benchmarks import DEFAULT, find_benchmark
from jansen_env.scoring.evaluation import evaluate
from jansen_env.scoring.rollout import make_env

KINDS = ("onnx", "c")
CASES = 10_000  # observations on which is compared
EXACT = ("ONNX", "C in double")  # the others compute in float32


def read(run: str, env_id: str | None = None) -> tuple[PretrainedPolicy, str]:
    """Return the policy and the name of what :func:`export` is given."""
    name = ALIASES.get(run, run)
    if name.startswith(SHIPPED):
        run = str(pretrained.shipped(env_id or DEFAULT, name.removeprefix(SHIPPED)))
    elif env_id is not None:
        raise ValueError(f"--env is {env_id}, but {run} says itself what it was trained on")
    if Path(run).suffix == ".json":
        return pretrained.load_file(run), Path(run).stem
    policy = from_run(run)
    return policy, policy.description["training"]["config"]["algo"]


def make_cases(policy: PretrainedPolicy, count: int) -> Array:
    """Return observations (count, d): half within two standard deviations of their mean in
    training, a quarter within twenty, a quarter far beyond the clip of the scaling."""
    rng = np.random.default_rng(0)
    spread = rng.normal(size=(count, len(policy.observed)))
    spread *= np.repeat([1.0, 10.0, 1e4], [count // 2, count // 4, count - 3 * count // 4])[:, None]
    return random_observations(policy, spread, rng)


def actions_of(policy: Policy, cases: Array) -> Array:
    """Return a policy's actions (n,)."""
    with np.errstate(over="ignore"):  # of what lies far beyond
        return np.asarray(policy.predict(cases, deterministic=True)[0], float)[:, 0]


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
        command: named in the card.

    Returns:
        The files, the card last; the largest difference of an action to PyTorch's in float64, by
        what computes it, None for what could not be run here.

    Raises:
        ValueError: there is no such policy, it is damaged, or it has a part that cannot be packed;
            the name is none for C; or what was made does not act as the policy does.
    """
    policy, short = read(run, env_id)
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", f"{policy.env_id}_{short}").lower()
    default = re.sub(r"[^a-z0-9]+", "_", words).strip("_")[:63]
    name = c_source.check_name(default if name is None else name)
    env = make_env(policy.env_id, policy.env_kwargs)
    policy.on(env)
    baselines = {
        key: load(env.unwrapped) for key, load in find_benchmark(policy.env_id).baselines.items()
    }
    env.close()
    cases = make_cases(policy, CASES)
    files: dict[str, bytes] = {}
    actions: dict[str, Array | None] = {}
    if "onnx" in kinds:
        model = onnx_model.build(policy, name)
        files[f"{name}.onnx"] = model.SerializeToString()
        actions["ONNX"] = onnx_model.run(model, cases)
    if "c" in kinds:
        sources = c_source.sources(policy, name)
        files |= {file: text.encode("ascii") for file, text in sources.items()}
        program = {**sources, "main.c": c_source.example(policy, name)}
        actions["C in double"] = c_source.run(program, name, cases)
        options = (*c_source.OPTIONS, f"-D{name.upper()}_SINGLE_PRECISION")
        actions["C in float"] = c_source.run(program, name, cases, options)
    actions["PyTorch itself in float32"] = actions_of(to_policy(policy), cases)
    expected = actions_of(in_float64(to_policy(policy)), cases)
    differences = {
        what: None if theirs is None else float(np.abs(theirs - expected).max())
        for what, theirs in actions.items()
    }
    for what in {*EXACT} & {*differences}:
        if not (differences[what] or 0.0) <= TOLERANCE:
            raise ValueError(
                f"actions of {what} differ by {differences[what]:.2g} from PyTorch's, must be "
                f"{TOLERANCE} at most: nothing was written"
            )
    scores = evaluate({name: policy, **baselines}, policy.env_id, policy.env_kwargs,
                      episodes=episodes, seed=seed)  # fmt: skip
    text = card(policy, files, name=name, run=run, command=command, differences=differences,
                example=c_source.example(policy, name) if "c" in kinds else "", scores=scores,
                compared=len(cases), seen=cases[0], episodes=episodes, seed=seed)  # fmt: skip
    files[f"{name}.md"] = text.encode("utf-8")
    return [write_bytes(Path(out) / file, data) for file, data in files.items()], differences


def main(arguments: list[str] | None = None) -> None:
    """Export a policy, and say what was written and how well it agrees."""
    words = sys.argv[1:] if arguments is None else arguments
    parser = Parser("python -m agents.export", __doc__,
                    "python -m agents.export pretrained --to c",
                    "python -m agents.export logs/ppo/JansenWalkerBuilt-v0_1 --to onnx --out robot"
                    )  # fmt: skip
    add = parser.add_argument
    add("run", metavar="RUN", help="a run's folder, a model's zip file with config.yml beside it, "
        "a policy's json file, 'pretrained' or 'pretrained:NAME'")  # fmt: skip
    add("--to", action="append", required=True, choices=KINDS,
        help="what to write; given again, several of them")  # fmt: skip
    add("--env", type=env_id, metavar="ID", help=f"of 'pretrained'; default: {DEFAULT}")
    add("--out", default="exports", metavar="DIR", help="folder of the files; default: exports")
    add("--name", help="of the files and of functions in C; default: such as jansen_walker_v0_ppo")
    add("--episodes", type=positive_int, default=10,
        help="per command, of the scores in the model card; default: 10")  # fmt: skip
    add("--seed", type=non_negative_int, default=0, help="of the scores; default: 0")
    args = parser.parse_args(words)
    if "onnx" in args.to:
        need("export", *onnx_model.NEEDED, who="--to onnx")
    torch.set_num_threads(1)  # of a network this small more only wait for one another
    command = shlex.join(["python", "-m", "agents.export", *words])
    print(f"comparing on {CASES} observations, then scoring beside the baselines ...", flush=True)
    with parser.refusing():
        paths, differences = export(
            args.run, args.to, args.out, args.name, args.env, args.episodes, args.seed, command
        )
    for path in paths:
        print(f"written: {path} ({path.stat().st_size / 1000:.1f} kB)")
    for what, difference in differences.items():
        text = "not run: no C compiler here" if difference is None else f"{difference:.2g}"
        print(f"largest difference of an action to PyTorch's in float64, {what}: {text}")
