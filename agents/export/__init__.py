"""Take a policy along: ``python -m agents.export RUN --to onnx --to c`` writes it for onnxruntime
and as C99 source for a microcontroller.

Exports are compared with the policy on 10,000 observations first. If an action differs by more than
1e-6, nothing is written.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agents import need
from agents.export import c_source, onnx_model
from agents.pack import TOLERANCE, from_run, random_observations
from jansen_env.baselines.policy import Array
from jansen_env.commands.flags import Parser, env_id
from jansen_env.commands.named_policies import shipped_file
from jansen_env.files import write_bytes
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.scoring.benchmarks import DEFAULT

KINDS = ("onnx", "c")
CASES = 10_000  # observations on which is compared


def read(run: str, env_id: str | None = None) -> tuple[PretrainedPolicy, str]:
    """Return the policy and the name of what :func:`export` is given."""
    if (file := shipped_file(run, env_id or DEFAULT)) is not None:
        run = str(file)
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


def export(
    run: str, kinds: Sequence[str], out: str | Path = "exports", name: str | None = None,
    env_id: str | None = None,
) -> tuple[list[Path], dict[str, float | None]]:  # fmt: skip
    """Write a policy into a folder.

    Args:
        run: a run's folder, a model's zip file, a policy's json file, ``"pretrained"`` or
            ``"pretrained:NAME"``. env_id: of the last two; None for the default.
        kinds: of :data:`KINDS`. out: the folder.
        name: of the files, and of functions in C; None for one such as jansen_walker_v0_ppo.

    Returns:
        The files; the largest difference of an action to the policy's, by kind, None for what could
        not be run here.

    Raises:
        ValueError: there is no such policy, it is damaged, or it has a part that cannot be packed;
            the name is none for C; or what was made does not act as the policy does.
    """
    policy, short = read(run, env_id)
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", f"{policy.env_id}_{short}").lower()
    default = re.sub(r"[^a-z0-9]+", "_", words).strip("_")[:63]
    name = c_source.check_name(default if name is None else name)
    cases = make_cases(policy, CASES)
    files: dict[str, bytes] = {}
    actions: dict[str, Array | None] = {}
    if "onnx" in kinds:
        model = onnx_model.build(policy, name)
        files[f"{name}.onnx"] = model.SerializeToString()
        actions["onnx"] = onnx_model.run(model, cases)
    if "c" in kinds:
        sources = c_source.sources(policy, name)
        files |= {file: text.encode("ascii") for file, text in sources.items()}
        actions["c"] = c_source.run(sources, name, cases)
    expected = policy.predict(cases)[0][:, 0]
    differences = {
        kind: None if found is None else float(np.abs(found - expected).max())
        for kind, found in actions.items()
    }
    for kind, difference in differences.items():
        if not (difference or 0.0) <= TOLERANCE:
            raise ValueError(
                f"actions of {kind} differ by {difference:.2g} from the policy's, must be "
                f"{TOLERANCE} at most: nothing was written"
            )
    return [write_bytes(Path(out) / file, data) for file, data in files.items()], differences


def main(arguments: list[str] | None = None) -> None:
    """Export a policy, and say what was written and how well it agrees."""
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
    args = parser.parse_args(arguments)
    if "onnx" in args.to:
        need("export", *onnx_model.NEEDED, who="--to onnx")
    with parser.refusing():
        paths, differences = export(args.run, args.to, args.out, args.name, args.env)
    for path in paths:
        print(f"written: {path} ({path.stat().st_size / 1000:.1f} kB)")
    for kind, difference in differences.items():
        text = "not run: no C compiler here" if difference is None else f"{difference:.2g}"
        print(f"largest difference of an action on {CASES} observations, {kind}: {text}")
