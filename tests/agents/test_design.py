"""The search for linkages: plans, variables, measures, methods, journals, reports."""

import json
import math
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import yaml

from agents.design import __main__ as command
from agents.design import design_report, search
from agents.design.design_plan import PLANS, make_plan, read_plan
from agents.design.measures import HELD, MEASURES, SEED, STEPS, Walker
from agents.design.optimisers import Cma, MapElites, Nsga2
from agents.design.shape import clearance, geometry_measures
from agents.design.variables import Candidate, Space
from agents.tuning.profile_search import profiles
from jansen_env import ROBOTS
from jansen_env.commands.named_policies import load_named
from jansen_env.robot import Bar
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.robot_file import read_robot, write_robot
from jansen_env.robot.zoo import standing_height
from jansen_env.scoring.rollout import make_env

SHORT = {"max_episode_steps": 150}
SMALL = {
    "speed": 0.3, "generations": 3, "population": 4, "starts": 1, "env_kwargs": SHORT,
    "variables": {"lengths": 0.02, "harmonics": 1},
    "objectives": {"steady_cost_of_transport": "min"}, "limits": {"falls": [None, 0]},
}  # fmt: skip
METHODS = {
    "cma": {},
    "nsga2": {"objectives": {"steady_cost_of_transport": "min", "lift": "max"}},
    "map_elites": {"map": {"lift": [0.0, 0.2, 5], "mass": [4.0, 6.0, 5]}},
}


def plan_of(method="cma", **more):
    """A small search."""
    return make_plan({**SMALL, "method": method, **METHODS[method], **more})


@pytest.fixture(scope="module")
def walker():
    """Walks up to four candidates for 3 s."""
    return Walker("JansenWalkerBuilt-v0", {**SHORT, "robot": "built"}, 0.3, 2, 4)


@pytest.mark.parametrize("name", sorted(path.stem for path in PLANS.glob("*.yml")))
def test_shipped_plans_are_complete(name, monkeypatch):
    """And begin at the robot they name."""
    monkeypatch.chdir(PLANS.parents[2])
    plan = read_plan(name)
    assert plan.space().variables


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"method": "luck"}, "method is 'luck', must be"),
        ({"sped": 1}, "'sped' is no key"),
        ({"generations": None}, "generations is None"),
        ({"variables": {}}, "variables is {}"),
        ({"variables": {"wheels": 1}}, "variables has 'wheels'"),
        ({"variables": {"lengths": 2.0}}, "variables.lengths is 2.0"),
        ({"variables": {"lengths": {"shin": 0.1}}}, "variables.lengths has 'shin', must be of"),
        ({"variables": {"motors": ["diesel"]}}, r"variables.motors is \['diesel'\]"),
        ({"variables": {"pins": [0]}}, r"variables.pins is \[0\]"),
        ({"variables": {"pins": [2], "phases": 0.1}}, "has pins and phases"),
        ({"robot": "centipede"}, "robot is 'centipede'"),
        ({"profile": "none.json"}, "none.json cannot be read"),
        ({"env": "CartPole-v1"}, "env is 'CartPole-v1'"),
        ({"env_kwargs": {"colour": 1}}, "'colour' is no argument"),
        ({"env_kwargs": {"robot": "paper"}}, "env_kwargs has 'robot', which the search sets"),
        ({"objectives": {"beauty": "max"}}, "objectives has 'beauty', must be of"),
        ({"objectives": {"mass": "min", "lift": "max"}}, "objectives has 2 entries, cma must"),
        ({"limits": {"mass": 3}}, r"limits.mass is 3, must be \[least, most\]"),
        ({"limits": {"mass": [2, 1]}}, r"limits.mass is \[2, 1\]"),
        ({"map": {"mass": [0, 1, 5]}}, "map has 1 entries"),
        ({"policy": "pretrained"}, "variables has .*, must have lengths alone beside a policy"),
    ],
)
def test_a_plan_with_a_fault_is_refused(changes, message):
    """In one line that names the entry."""
    with pytest.raises(ValueError, match=message) as error:
        make_plan({**SMALL, "method": "cma", **changes})
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="the plan lacks 'speed'"):
        make_plan({name: value for name, value in SMALL.items() if name != "speed"})


def test_the_start_is_the_design_itself():
    """Its lengths, motor and profile; the ends of the range are the share."""
    space = Space("built", 0.3, {"lengths": 0.2, "harmonics": 2, "motors": ["ak80_6", "mx_106"]})
    robot = space.candidate(space.start).robot
    assert lengths(robot) == pytest.approx(lengths(ROBOTS["built"]()), rel=1e-12)
    assert robot.mass == pytest.approx(ROBOTS["built"]().mass, rel=1e-4)
    low, high = (space.candidate(np.full(len(space.start), end)).robot for end in (0.0, 1.0))
    for name, value in lengths(ROBOTS["built"]()).items():
        assert lengths(low)[name] == pytest.approx(0.8 * value)
        assert lengths(high)[name] == pytest.approx(1.2 * value)
    assert low.motor != high.motor


def test_crank_pins_and_phases_are_variables():
    """Pins make other legs, phases turn cranks; the first leg's stays."""
    space = Space("built", 0.3, {"pins": [2, 3]})
    assert [len(space.candidate(np.array([u])).robot.legs) for u in (0.1, 0.9)] == [4, 6]
    space = Space("built", 0.3, {"phases": 0.4})
    assert len(space.variables) == 1
    turned = space.candidate(np.ones(1)).robot
    assert [leg.phase for leg in turned.legs] == pytest.approx([0.0, np.pi + 0.4] * 2)


def test_the_shape_of_the_built_robot():
    """Against its kinematics' own numbers; what does not close has a closure of -1."""
    built = ROBOTS["built"]()
    found = geometry_measures(built)
    assert found["height"] == pytest.approx(standing_height(built), abs=1e-4)
    assert found["lift"] == pytest.approx(0.0884, abs=1e-4)
    assert found["mass"] == built.mass and found["longest"] == pytest.approx(0.436, abs=1e-3)
    broken = geometry_measures(with_lengths(built, {"rocker": 0.05}))
    assert broken["closure"] == -1.0 and math.isnan(broken["lift"])
    heavy = replace(built, bodies=tuple(replace(link, mass=500.0) for link in built.bodies))
    assert geometry_measures(heavy)["closure"] == -1.0


def test_links_in_one_plane_keep_apart_or_cross(walker):
    """Crank and rocker of the paper's leg never meet; upper rod and frame cross. What shares a
    plane of the built robot's drawings has a gap."""
    paper, names = ROBOTS["paper"](), ROBOTS["paper"]().linkage.names
    frame, crank, rocker, rod = ((0, names.index(name)) for name in (
        "frame", "crank", "rocker", "upper_rod"))  # fmt: skip
    assert clearance(paper, [(crank, rocker)]) == pytest.approx(0.201, abs=2e-3)
    assert clearance(paper, [(crank, rocker), (frame, rod)]) == pytest.approx(-0.015)
    own = Candidate(ROBOTS["built"](), np.ones(4))
    large = Candidate(with_lengths(own.robot, {"coupler": 0.27}), own.numbers)
    gaps = walker.measure("planes", [own, large])["clearance"]
    assert 0.0 < gaps[0] < 0.3 and gaps[0] != gaps[1]


def test_walks_are_scored_as_everywhere(walker):
    """Of two candidates: the numbers of the same walks by themselves, and of each in any place."""
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
            action, _ = policy.predict(seen, None, np.zeros(1, bool), True)
            seen, _, fallen, late, info = env.step(action)
            work += abs(info["energy"]["motor_work"])
            over = fallen or late
        way += info["x_position"]
    cost = work / (env.unwrapped.task.world.weight[0] * way)
    assert both["cost_of_transport"][1] == pytest.approx(cost, rel=1e-6)


def test_a_held_leg_is_measured_too(walker):
    """As :mod:`agents.design.held_leg` has it; what does not close has no numbers."""
    broken = with_lengths(ROBOTS["built"](), {"rocker": 0.05})
    two = [Candidate(robot, np.ones(4)) for robot in (ROBOTS["built"](), broken)]
    found = walker.measure("held", two)
    assert {*found} == {*HELD} and found["leg_wear"][0] > 0.0 and np.isnan(found["leg_wear"][1])


def test_wear_grows_with_what_slides(walker):
    """Twice the weight on the same lengths: about twice the load times sliding."""
    start = Space("built", 0.3, {"lengths": 0.1})
    one = start.candidate(start.start)
    more = [replace(link, mass=1.5 * link.mass) for link in one.robot.bodies]
    heavy = replace(one.robot, bodies=tuple(more))
    found = walker.measure("loads", [one, Candidate(heavy, one.numbers)])
    assert 1.2 < found["wear"][1] / found["wear"][0] < 2.0
    assert found["pin_force"].min() > 100.0 and found["rod_safety"].max() < 20.0


def test_climbing_counts_heights(walker):
    """A step that falls short of nothing; the slow and short walk is refused."""
    start = Space("built", 0.4, {"lengths": 0.1})
    whole = Walker("JansenWalkerBuilt-v0", {"robot": "built"}, 0.4, 1, 1)
    climbed = whole.measure("climb", [start.candidate(start.start)])["climb"]
    assert STEPS[0] < climbed[0] < STEPS[-1]
    with pytest.raises(ValueError, match=r"climb at speed .* and a time limit of 3 s ends"):
        walker.measure("climb", [start.candidate(start.start)])


def test_copies_are_as_bad_as_the_worst(walker):
    """No better than what they copy, but for noise."""
    start = Space("built", 0.3, {"lengths": 0.1})
    one = [start.candidate(start.start)]
    cost = walker.measure("walk", one)["steady_cost_of_transport"][0]
    assert walker.measure("copies", one)["worst_copy"][0] > 0.9 * cost


@pytest.mark.parametrize("make", [
    lambda start: Cma(start, 12, 3),
    lambda start: Nsga2(start, 12, 3, 2),
    lambda start: MapElites(start, 12, 3, [4, 4], [(0.0, 1.0)] * 2),
])  # fmt: skip
def test_methods_improve_and_repeat(make):
    """On a bowl within a limit: nearer than at first; the same answers, the same questions."""

    def play():
        method, asked = make(np.full(3, 0.2)), []
        for _ in range(25):
            unit = method.ask()
            assert unit.shape == (12, 3) and unit.min() >= 0.0 and unit.max() <= 1.0
            value = ((unit - 0.6) ** 2).sum(axis=1)
            other = ((unit - 0.5) ** 2).sum(axis=1)
            objectives = np.stack([value, other], axis=1)[:, : 2 if "Nsga2" in repr(method) else 1]
            method.tell(objectives, np.maximum(unit[:, 0] - 0.65, 0.0), unit[:, :2])
            asked.append((unit, value))
        return asked

    first, again = play(), play()
    assert all(np.array_equal(a[0], b[0]) for a, b in zip(first, again, strict=True))
    assert min(value.min() for _, value in first[-5:]) < 0.3 * first[0][1].min()


@pytest.mark.parametrize("method", METHODS)
def test_a_killed_search_goes_on_bit_for_bit(method, tmp_path):
    """Cut in the midst of a line of its journal: the end is that of a search that was not."""
    plan = plan_of(method)
    whole = search.run_search(plan, 0, tmp_path / "a")
    part = search.run_search(replace(plan, generations=2), 0, tmp_path / "b")
    journal = tmp_path / "b" / search.JOURNAL
    journal.write_bytes(journal.read_bytes()[:-20])
    told = search.read_journal(journal, plan)
    assert len(told) == 1 and np.array_equal(told[0].unit, part.unit[:4])
    again = search.run_search(plan, 0, tmp_path / "b")
    assert journal.read_bytes() == (tmp_path / "a" / search.JOURNAL).read_bytes()
    assert np.array_equal(again.unit, whole.unit) and len(whole.unit) == 12


def test_a_policy_turns_the_crank(tmp_path):
    """In place of profiles; it sees lengths as the episode's."""
    path = tmp_path / "own.yml"
    own = {**SMALL, "variables": {"lengths": 0.02}, "policy": "pretrained", "generations": 1}
    path.write_text(yaml.safe_dump(own))
    assert command.main([str(path), "--log-folder", str(tmp_path)]) == 0
    assert not (tmp_path / "own" / "seed_0" / design_report.PROFILE).exists()
    journal = tmp_path / "own" / "seed_0" / search.JOURNAL
    found = search.joined(search.read_journal(journal, read_plan(path)))
    assert found.measured["falls"][0] == 0.0 and len(found.unit) == 4


def test_limits_rank_what_breaks_them():
    """By how much of the bound, always less than what is not measured."""
    plan = plan_of(limits={"mass": [None, 5.0], "falls": [None, 0], "lift": [0.1, None]})
    measured = {
        "closure": np.ones(3), "mass": np.array([4.0, 6.0, 4.0]),
        "falls": np.array([0.0, 0.5, np.nan]), "lift": np.array([0.2, 0.05, 0.1]),
    }  # fmt: skip
    assert search.broken(plan, measured, plan.measured) == pytest.approx(
        [0.0, 0.2 / 1.2 + 2.0 * 0.5 / 1.5, 1.0]
    )


def test_what_cannot_turn_is_not_walked(walker):
    """It breaks all limits on walks; lengths without a triangle, too."""
    plan = plan_of()
    broken = with_lengths(ROBOTS["built"](), {"rocker": 0.05})
    measured, violation = search.measure(plan, walker, [Candidate(broken, np.ones(4)), None])
    assert np.isnan(measured["falls"]).all() and (violation >= 2.0).all()
    assert set(measured) <= set(MEASURES)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda line: line.replace('"unit"', '"units"'), "line 1, is damaged"),
        (lambda line: "[]", "line 1, is damaged"),
        (lambda line: line.replace('"falls"', '"fells"'), "line 1, is damaged: .*must have"),
        (
            lambda line: json.dumps({**json.loads(line), "violation": [[0.0]] * 4}),
            "differ in length",
        ),
        (lambda line: line.replace("0.", "1.", 1), "line 1, is not what this search asks for"),
    ],
)
def test_a_damaged_journal_is_refused(change, message, tmp_path):
    """With the line."""
    plan = plan_of(generations=1)
    search.run_search(plan, 0, tmp_path)
    journal = tmp_path / search.JOURNAL
    journal.write_text(change(journal.read_text().strip()) + "\n")
    with pytest.raises(ValueError, match=message):
        search.run_search(plan, 0, tmp_path)


@pytest.mark.parametrize("method", ["cma", *(pytest.param(name, marks=pytest.mark.slow)
                                             for name in ("nsga2", "map_elites"))])  # fmt: skip
def test_the_command_searches_and_reports(method, tmp_path, capsys):
    """A robot file and a profile that walk as the report says, pictures, the same again."""
    path = tmp_path / "own.yml"
    plan = {**SMALL, "method": method, **METHODS[method]}
    path.write_text(yaml.safe_dump(plan, sort_keys=False))
    arguments = [str(path), "--log-folder", str(tmp_path / "logs"), "--generations", "2"]
    arguments += ["--variables", "{lengths: 0.01, harmonics: 1}"]
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
    assert command.main(["--report", str(folder), "--all"]) == 0
    assert report in capsys.readouterr().out
    robot = read_robot(folder / "seed_0" / design_report.ROBOT)
    assert isinstance(robot.body("rocker"), Bar)
    with gym.make("JansenWalkerBuilt-v0", robot=robot) as env:
        policy = load_named(f"profile:{folder / 'seed_0' / design_report.PROFILE}", env)
        seen, _ = env.reset(seed=0)
        assert policy.predict(seen, None, np.zeros(1, bool), True)[0].shape == (1,)
    with pytest.raises(SystemExit):
        command.main([*arguments, "--speed", "0.4"])
    assert "holds another search: ['speed'] differ" in capsys.readouterr().err


@pytest.mark.parametrize("arguments, message", [
    ([], "is needed"),
    (["cost", "--report", "x"], "one of them alone"),
    (["clmb"], "plan is 'clmb', must be one of ['climb', 'cost', 'front', "),
    (["--report", "nowhere"], "nowhere/plan.yml cannot be read"),
])  # fmt: skip
def test_bad_arguments_get_one_line(arguments, message, capsys):
    """And no traceback."""
    with pytest.raises(SystemExit):
        command.main(arguments)
    assert message in capsys.readouterr().err.splitlines()[0]


@pytest.mark.slow
def test_seeds_run_in_processes(tmp_path):
    """Two, by the command itself; each as it is alone."""
    path = tmp_path / "own.yml"
    path.write_text(yaml.safe_dump({**SMALL, "method": "cma", "seeds": 2, "generations": 1}))
    arguments = [str(path), "--log-folder", str(tmp_path)]
    subprocess.run([sys.executable, "-m", "agents.design", *arguments], check=True)
    assert "Apart from each other" in (tmp_path / "own" / "report.md").read_text()
    alone = tmp_path / "alone"
    search.run_search(plan_of(generations=1), 1, alone)
    journal = tmp_path / "own" / "seed_1" / search.JOURNAL
    assert json.loads(journal.read_text()) == json.loads((alone / search.JOURNAL).read_text())


def test_designs_agree_with_themselves():
    """Twice the same: nothing apart; a crank a tenth longer: a thirteenth of a tenth."""
    built = ROBOTS["built"]()
    longer = with_lengths(built, {"crank": 1.1 * lengths(built)["crank"]})
    text = design_report.agreement([built, longer, longer])
    assert "each other in the mean: paths 0.0 % of their width, lengths 0.0 %" in text
    assert "lengths 0.8 %." in text


def test_a_folder_has_one_search(tmp_path, capsys):
    """Not two at once, and not another robot under the same name."""
    with search.locked(tmp_path), pytest.raises(ValueError, match="is in use by"):
        search.run_search(plan_of(generations=1), 0, tmp_path)
    robot = write_robot(tmp_path / "own.json", ROBOTS["built"]())
    plan = plan_of(generations=1, robot=str(robot))
    command.enter(tmp_path / "search", plan)
    write_robot(robot, with_lengths(ROBOTS["built"](), {"rocker": 0.24}))
    with pytest.raises(ValueError, match=r"holds another search: \['robot'\] differ"):
        command.enter(tmp_path / "search", plan)


def test_a_copy_that_cannot_turn_is_the_worst(walker):
    """All but a dead point: infinite, and no error."""
    tight = with_lengths(ROBOTS["built"](), {"rocker": 0.171})
    assert 0.0 < geometry_measures(tight)["closure"] < 0.2
    start = Space("built", 0.3, {"lengths": 0.1})
    one = Candidate(tight, start.candidate(start.start).numbers)
    assert walker.measure("copies", [one])["worst_copy"][0] == np.inf
