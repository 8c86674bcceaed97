"""The command ``python -m agents.export``."""

from __future__ import annotations

import argparse
import shlex
import sys
from importlib.util import find_spec

import torch

from agents.command_line import non_negative_int, positive_int
from agents.export import CASES, KINDS, __doc__, export
from agents.export.onnx_model import NEEDED
from jansen_env.scoring.benchmarks import BENCHMARKS, DEFAULT


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser("python -m agents.export", description=__doc__)
    add = parser.add_argument
    add("run", metavar="RUN", help="a run's folder, a model's zip file with config.yml beside it, "
        "a policy's json file, 'pretrained' or 'pretrained:NAME'")  # fmt: skip
    add("--to", action="append", required=True, choices=KINDS,
        help="what to write; given again, several of them")  # fmt: skip
    add("--env", choices=sorted(BENCHMARKS), help=f"of 'pretrained'; default: {DEFAULT}")
    add("--out", default="exports", metavar="DIR", help="folder of the files; default: exports")
    add("--name", help="of the files and of functions in C; default: such as jansen_walker_v0_ppo")
    add("--episodes", type=positive_int, default=10,
        help="per command, of the scores in the model card; default: 10")  # fmt: skip
    add("--seed", type=non_negative_int, default=0, help="of the scores; default: 0")
    args = parser.parse_args(arguments)
    args.error, args.to = parser.error, tuple(dict.fromkeys(args.to))
    if "onnx" in args.to and (missing := [one for one in NEEDED if find_spec(one) is None]):
        parser.error(f"--to onnx needs {', '.join(missing)}, which the extra 'export' installs: "
                     'python -m pip install -e ".[export]"')  # fmt: skip
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
