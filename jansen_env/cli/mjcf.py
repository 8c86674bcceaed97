"""Write a robot on level ground as MJCF, the format of MuJoCo."""

from jansen_env.cli.flags import robot_parser
from jansen_env.files import write_text
from jansen_env.plants.mujoco_model import to_mjcf
from jansen_env.terrain import Terrain
from jansen_env.world.settings import load_robot


def main(arguments: list[str] | None = None) -> None:
    """Write the robot to a file, or print it.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = robot_parser(
        "jansen-env mjcf",
        __doc__,
        "FILE",
        "standard output",
        "jansen-env mjcf built --out built.xml",
        "jansen-env mjcf robot.json",
    )
    args = parser.parse_args(arguments)
    with parser.refusing():
        text = to_mjcf(load_robot("ROBOT", args.robot), Terrain.flat())
        if args.out is not None:
            write_text(args.out, text)
    if args.out is None:
        print(text, end="")
