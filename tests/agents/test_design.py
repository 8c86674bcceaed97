"""The search for linkages: plans, variables, measures, methods, journals, reports."""

import math
from dataclasses import replace
from importlib.util import find_spec

import gymnasium as gym
import numpy as np
import pytest
import yaml

from agents.design import __main__ as command
from agents.design import design_report, search
from agents.design.design_plan import PLANS, make_plan, read_plan
from agents.design.measures import SEED, STEPS, Walker, clearance, geometry_measures, profiles
from agents.design.search import Cma, Nsga2
from agents.design.variables import Candidate, Space
from jansen_env import ROBOTS
from jansen_env.cli.named_policies import load_named
from jansen_env.robot.buildable import WIDTH
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.robot_file import read_robot, write_robot
from jansen_env.robot.zoo import standing_height
from jansen_env.scoring.rollout import make_env

SHORT = {"max_episode_steps": 150}
SMALL = {
    "speed": 0.3,
    "generations": 3,
    "population": 4,
    "starts": 1,
    "env_kwargs": SHORT,
    "variables": {"lengths": 0.02, "harmonics": 1},
    "objectives": {"steady_cost_of_transport": "min"},
    "limits": {"falls": [None, 0]},
}
needs_pymoo = pytest.mark.skipif(
    find_spec("pymoo") is None, reason="the extra 'design' is not installed"
)
METHODS = {"cma": {}, "nsga2": {"objectives": {"steady_cost_of_transport": "min", "lift": "max"}}}
BUILT = ROBOTS["built"]()
OPEN = Candidate(with_lengths(BUILT, {"rocker": 0.05}), np.ones(4))  # its linkage cannot turn


def plan_of(method="cma", **more):
    """A small search."""
    return make_plan({**SMALL, "method": method, **METHODS[method], **more})


def begin(speed=0.3):
    """The candidate that a search begins with."""
    space = Space("built", speed, {"lengths": 0.1})
    return space.candidate(space.start)


@pytest.fixture(scope="module")
def walker():
    """Walks up to four candidates for 3 s."""
    return Walker("JansenWalkerBuilt-v0", {**SHORT, "robot": "built"}, 0.3, 2, 4)


@pytest.mark.parametrize("name", sorted(path.stem for path in PLANS.glob("*.yml")))
def test_shipped_plans_are_complete(name, monkeypatch):
    """Each plan can be read and begins at the robot that it names."""
    monkeypatch.chdir(PLANS.parents[2])
    assert read_plan(name).space().variables


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"sped": 1}, "a key must be one of .*, got 'sped'"),
        ({"variables": {}}, "variables must have some of .*, got {}"),
        ({"variables": {"wheels": 1}}, "a key of variables must be one of .*, got 'wheels'"),
        ({"variables": {"lengths": 2.0}}, "variables.lengths must be .*, got 2.0"),
        (
            {"variables": {"lengths": {"shin": 0.1}}},
            "a key of variables.lengths must be one of .*, got 'shin'",
        ),
        ({"robot": "centipede"}, "robot must be .*, got 'centipede'"),
        ({"profile": "none.json"}, "none.json cannot be read"),
        (
            {"env_kwargs": {"colour": 1}},
            "an argument of JansenWalkerBuilt-v0 must be one of.*, got 'colour'",
        ),
        (
            {"env_kwargs": {"robot": "paper"}},
            "env_kwargs must not contain 'robot', which the search sets",
        ),
        ({"objectives": {"beauty": "max"}}, "a key of objectives must be one of .*, got 'beauty'"),
        ({"objectives": {"mass": "min", "lift": "max"}}, "objectives must have .* with cma, got 2"),
        ({"limits": {"mass": 3}}, r"limits\.mass must be \[least, most\], either of.*, got 3"),
        ({"limits": {"mass": [2, 1]}}, r"limits.mass must be .*, got \[2, 1\]"),
    ],
)
def test_a_plan_with_a_fault_is_refused(changes, message):
    with pytest.raises(ValueError, match=message) as error:
        make_plan({**SMALL, "method": "cma", **changes})
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="a plan must have the entry 'speed'"):
        make_plan({name: value for name, value in SMALL.items() if name != "speed"})


def test_the_start_is_the_design_itself():
    """The start has the lengths and the profile of the design; the ends of the range are at the
    share.
    """
    space = Space("built", 0.3, {"lengths": 0.2, "harmonics": 2})
    robot = space.candidate(space.start).robot
    assert lengths(robot) == pytest.approx(lengths(BUILT), rel=1e-12)
    assert robot.mass == pytest.approx(BUILT.mass, rel=1e-4)
    low, high = (space.candidate(np.full(len(space.start), end)).robot for end in (0.0, 1.0))
    for name, value in lengths(BUILT).items():
        assert lengths(low)[name] == pytest.approx(0.8 * value)
        assert lengths(high)[name] == pytest.approx(1.2 * value)


def test_the_shape_of_the_built_robot():
    """Measures of the shape are those of its kinematics; a leg that does not close has a closure of
    -1.
    """
    shape = geometry_measures(BUILT)
    assert shape["height"] == pytest.approx(standing_height(BUILT), abs=1e-4)
    assert shape["lift"] == pytest.approx(0.0884, abs=1e-4)
    assert shape["mass"] == BUILT.mass and shape["longest"] == pytest.approx(0.436, abs=1e-3)
    broken = geometry_measures(OPEN.robot)
    assert broken["closure"] == -1.0 and math.isnan(broken["lift"])
    heavy = replace(BUILT, bodies=tuple(replace(link, mass=500.0) for link in BUILT.bodies))
    assert geometry_measures(heavy)["closure"] == -1.0


def test_links_in_one_plane_keep_apart_or_cross(walker):
    """Crank and rocker of the paper's leg never meet; upper rod and frame cross.

    Parts that share a plane of the built robot's drawings have a gap.
    """
    paper = ROBOTS["paper"]()
    names = ("frame", "crank", "rocker", "upper_rod")
    frame, crank, rocker, rod = ((0, paper.linkage.names.index(name)) for name in names)
    recorded_gap = 0.201  # m, of this code
    assert clearance(paper, [(crank, rocker)]) == pytest.approx(recorded_gap, abs=2e-3)
    assert clearance(paper, [(crank, rocker), (frame, rod)]) == pytest.approx(-WIDTH)
    large = Candidate(with_lengths(BUILT, {"coupler": 0.27}), np.ones(4))
    gaps = walker.measure("planes", [Candidate(BUILT, np.ones(4)), large])["clearance"]
    assert 0.0 < gaps[0] < 0.3 and gaps[0] != gaps[1]


def test_a_path_is_compared_with_the_first_robots(walker):
    """A path keeps its shape at any size; another coupler gives another shape."""
    twice = {name: 2.0 * v for name, v in lengths(BUILT).items() if name != "frame_angle"}
    robots = [BUILT, with_lengths(BUILT, twice), with_lengths(BUILT, {"coupler": 0.27})]
    errors = walker.measure("path", [Candidate(robot, np.ones(4)) for robot in robots])
    assert errors["path_error"][:2] == pytest.approx(0.0, abs=1e-9)
    assert 0.05 < errors["path_error"][2] < 1.0


def test_walks_are_scored_as_everywhere(walker):
    """The numbers of two candidates are those of the same walks by themselves, in either place."""
    space = Space("built", 0.3, {"lengths": 0.1})
    rng = np.random.default_rng(2)
    two = [space.candidate(space.start + 0.1 * rng.standard_normal(13)) for _ in range(2)]
    both, alone = walker.measure("walk", two), walker.measure("walk", two[1:])
    for name, values in both.items():
        assert values[1] == pytest.approx(alone[name][0], rel=1e-12, nan_ok=True)
    env = make_env("JansenWalkerBuilt-v0", {**SHORT, "robot": two[1].robot, "speed_command": 0.3})
    work = way = 0.0
    policy = profiles(two[1].numbers[None], env)
    for k, angle in enumerate(walker.angles):
        seen, _ = env.reset(seed=SEED + k, options={"crank_angle": float(angle)})
        over = False
        while not over:
            seen, _, fallen, late, info = env.step(policy.predict(seen)[0])
            work += abs(info["energy"]["motor_work"])
            over = fallen or late
        way += info["x_position"]
    cost = work / (env.unwrapped.task.world.weight[0] * way)
    assert both["cost_of_transport"][1] == pytest.approx(cost, rel=1e-6)


def test_wear_grows_with_what_slides(walker):
    """Half more weight on the same lengths gives more load times sliding, although walks are
    chaotic.
    """
    light = begin()
    bodies = tuple(replace(link, mass=1.5 * link.mass) for link in light.robot.bodies)
    heavy = Candidate(replace(light.robot, bodies=bodies), light.numbers)
    loads = walker.measure("loads", [light, heavy])
    assert 1.2 < loads["wear"][1] / loads["wear"][0] < 2.5
    assert loads["pin_force"].min() > 100.0 and loads["rod_safety"].max() < 20.0


def test_climbing_counts_heights(walker):
    """The mean height is within those tried; a walk too short for a step is refused."""
    whole = Walker("JansenWalkerBuilt-v0", {"robot": "built"}, 0.4, 1, 1)
    space = Space("climber", 0.4, {"lengths": 0.1})
    measured = whole.measure("climb", [space.candidate(space.start)])
    assert STEPS[0] < measured["climb"][0] < STEPS[-1]
    assert 0.0 <= measured["links_in_ground"][0] < 0.1
    with pytest.raises(
        ValueError, match=r"climb must end at least .* at speed .* and a time limit of 3 s"
    ):
        walker.measure("climb", [begin(0.4)])


@pytest.mark.parametrize(
    ("method", "objectives"), [(Cma, ()), pytest.param(Nsga2, (2,), marks=needs_pymoo)]
)
def test_methods_improve(method, objectives):
    """On a bowl within a limit each method ends nearer than it began.

    The same seed gives the same search, also when the search was killed.
    """
    method = method(np.full(3, 0.2), 12, 3, *objectives)
    best = []
    for _ in range(25):
        unit = method.ask()
        assert unit.shape == (12, 3) and unit.min() >= 0.0 and unit.max() <= 1.0
        bowls = [((unit - middle) ** 2).sum(axis=1) for middle in (0.6, 0.5)]
        method.tell(np.stack(bowls, axis=1), np.maximum(unit[:, 0] - 0.65, 0.0))
        best.append(bowls[0].min())
    assert min(best[-5:]) < 0.3 * best[0]


@pytest.mark.parametrize("method", ["cma", pytest.param("nsga2", marks=needs_pymoo)])
def test_a_killed_search_goes_on_bit_for_bit(method, tmp_path):
    """A search that is killed after two generations and in the third ends as one that was not
    killed.
    """
    plan = plan_of(method)
    files = [0]

    def note(_):
        files.append((tmp_path / "a" / search.JOURNAL).stat().st_ino)

    whole = search.run_search(plan, 0, tmp_path / "a", note)
    assert all(np.diff(files))  # another file takes the journal's place, which is always whole

    def kill(searched):
        if len(searched) == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search.run_search(plan, 0, tmp_path / "b", kill)
    again = search.run_search(plan, 0, tmp_path / "b")
    assert len(whole) == 12 and again.tobytes() == whole.tobytes()
    first = search.run_search(replace(plan, generations=1), 0, tmp_path / "b")
    assert np.array_equal(first["unit"], whole["unit"][:4])


def test_limits_rank_what_breaks_them():
    """A violation counts as a share of the bound, and always less than a value that is not
    measured.
    """
    plan = plan_of(limits={"mass": [None, 5.0], "falls": [None, 0], "lift": [0.1, None]})
    measured = {
        "closure": np.ones(3),
        "mass": np.array([4.0, 6.0, 4.0]),
        "falls": np.array([0.0, 0.5, np.nan]),
        "lift": np.array([0.2, 0.05, 0.1]),
    }
    expected = [0.0, 0.2 / 1.2 + 2.0 * 0.5 / 1.5, 1.0]
    assert search.broken(plan, measured, plan.measured) == pytest.approx(expected)


def test_what_cannot_turn_is_not_walked(walker):
    """A crank that cannot turn, or lengths without a triangle, break all limits on walks."""
    measured, violation = search.measure(plan_of(), walker, [OPEN, None])
    assert np.isnan(measured["falls"]).all() and (violation >= 2.0).all()


def test_a_damaged_journal_is_refused(tmp_path):
    plan = plan_of(generations=1)
    path = tmp_path / search.JOURNAL
    journal = search.run_search(plan, 0, tmp_path)
    other = journal.copy()
    other["unit"] = 0.0
    for rows, message in (
        (journal[["unit", "violation"]], "is damaged: it must have rows of"),
        (other, "generation 1 of .* must contain the candidates that this search proposes"),
    ):
        np.save(path, rows)
        with pytest.raises(ValueError, match=message):
            search.run_search(plan, 0, tmp_path)
    path.write_bytes(b"PK")
    with pytest.raises(ValueError, match="is damaged"):
        search.run_search(plan, 0, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["cma", pytest.param("nsga2", marks=needs_pymoo)])
def test_the_command_searches_and_reports(method, tmp_path, capsys):
    """With two seeds it writes robot files and profiles that walk, and pictures; the same command
    writes the same report again.
    """
    path = tmp_path / "own.yml"
    plan = {**SMALL, "method": method, **METHODS[method]}
    path.write_text(yaml.safe_dump(plan, sort_keys=False))
    arguments = [str(path), "--log-folder", str(tmp_path / "logs"), "--generations", "2"]
    arguments += ["--variables", "{lengths: 0.01, harmonics: 1}", "--seeds", "2"]
    assert command.main(arguments) == 0
    printed, progress = capsys.readouterr()
    assert f"of {SMALL['population']} keep all limits, best steady_cost_of_transport: " in progress
    assert "steady_cost_of_transport" in printed and "half the time step" not in printed
    assert max(map(len, printed.splitlines())) <= 80 + len(str(tmp_path))
    folder = tmp_path / "logs" / "own"
    for name in ("report.md", "designs.png", "search.png", "plan.yml"):
        assert (folder / name).stat().st_size > 100
    report = (folder / "report.md").read_text()
    assert command.main(arguments) == 0 and (folder / "report.md").read_text() == report
    robot = read_robot(folder / "seed_1" / design_report.ROBOT)
    with gym.make("JansenWalkerBuilt-v0", robot=robot) as env:
        policy = load_named(f"profile:{folder / 'seed_1' / design_report.PROFILE}", env)
        assert np.isfinite(policy.predict(env.reset(seed=0)[0])[0]).all()
    with pytest.raises(SystemExit):
        command.main([*arguments, "--speed", "0.4"])
    assert "contains another search, with a different speed" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        command.main(["clmb"])
    first = capsys.readouterr().err.splitlines()[0]
    assert "plan must be one of [" in first and "'climb'" in first


def test_a_folder_has_one_search(tmp_path):
    """A second search at the same time is refused, and so is another robot under the same name."""
    with search.locked(tmp_path), pytest.raises(ValueError, match="is in use by"):
        search.run_search(plan_of(generations=1), 0, tmp_path)
    robot = write_robot(tmp_path / "own.json", BUILT)
    plan = plan_of(generations=1, robot=str(robot))
    command.enter(tmp_path / "search", plan)
    write_robot(robot, with_lengths(BUILT, {"rocker": 0.24}))
    with pytest.raises(ValueError, match=r"contains another search, with a different robot"):
        command.enter(tmp_path / "search", plan)
