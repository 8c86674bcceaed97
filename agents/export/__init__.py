"""Export a policy, for example: ``python -m agents.export RUN --to onnx --to c``.

``--to onnx`` writes a model for onnxruntime, ``--to c`` writes C99 source code for a
microcontroller, and ``--to firmware`` writes C99 source code with sensors and safety functions.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from agents import need
from agents.export import c_source, onnx_model
from agents.pack import read
from jansen_env.cli.flags import Parser, env_id, path_flag
from jansen_env.cli.named_policies import shipped_file
from jansen_env.files import write_bytes
from jansen_env.scoring.benchmarks import DEFAULT

KINDS = ("onnx", "c", "firmware")


def export(
    run: str,
    kinds: Sequence[str],
    out: str | Path = "exports",
    name: str | None = None,
    env_id: str | None = None,
) -> list[Path]:
    """Export a policy into a folder.

    Args:
        run: Folder of a run, zip file of a model, JSON file of a policy, ``"pretrained"`` or
            ``"pretrained:NAME"``.
        kinds: What to write, any of :data:`KINDS`.
        out: Folder to write to.
        name: Name of the files and of the functions in C. None selects a name such as
            jansen_walker_v0_ppo.
        env_id: Environment of a pretrained policy. None selects the default environment.

    Returns:
        The files.

    Raises:
        ValueError: If there is no such policy, if it is damaged, or if a part of it cannot be
            packed; if the name is not valid in C; or if the policy is not suitable for firmware.
    """
    file = shipped_file(run, env_id or DEFAULT)
    policy, short = read(file or run)
    if file is None and env_id is not None:
        raise ValueError(
            f"--env must not be given for {run}, whose files name the environment, got {env_id}"
        )
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", f"{policy.env_id}_{short}").lower()
    default = re.sub(r"[^a-z0-9]+", "_", words).strip("_")[:50]  # leaves room for _firmware
    name = c_source.check_name(default if name is None else name)
    files: dict[str, bytes] = {}
    if "onnx" in kinds:
        files[f"{name}.onnx"] = onnx_model.build(policy, name).SerializeToString()
    for kind, write in (("c", c_source.sources), ("firmware", c_source.firmware)):
        if kind in kinds:
            files |= {file: text.encode("ascii") for file, text in write(policy, name).items()}
    return [write_bytes(Path(out) / file, data) for file, data in files.items()]


def main(arguments: list[str] | None = None) -> None:
    """Export a policy and print the names and sizes of the files.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = Parser(
        "python -m agents.export",
        __doc__,
        "python -m agents.export pretrained --to c",
        "python -m agents.export logs/ppo/JansenWalkerBuilt-v0_1 --to onnx --out robot",
    )
    add = parser.add_argument
    add(
        "run",
        metavar="RUN",
        help="policy: the folder of a run, the zip file of a model with config.yml beside it, the "
        "JSON file of a policy, 'pretrained' or 'pretrained:NAME'",
    )
    add(
        "--to",
        action="append",
        required=True,
        choices=KINDS,
        help="format to write; repeat the flag to write several formats",
    )
    add(
        "--env",
        type=env_id,
        metavar="ID",
        help=f"environment of a 'pretrained' policy; default: {DEFAULT}",
    )
    add(
        "--out",
        type=path_flag,
        default="exports",
        metavar="DIR",
        help="folder of the files; default: exports",
    )
    add(
        "--name",
        help="name of the files, and of the functions in C; default: a name made of the "
        "environment and the policy, such as jansen_walker_v0_ppo",
    )
    args = parser.parse_args(arguments)
    if "onnx" in args.to:
        need("export", *onnx_model.NEEDED, who="--to onnx")
    with parser.refusing():
        for path in export(args.run, args.to, args.out, args.name, args.env):
            print(f"written: {path} ({path.stat().st_size / 1000:.1f} kB)")
