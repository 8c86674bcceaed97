"""The policies that come with the package, packing others, and refusing what is none."""

import inspect
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load, save
from small_runs import NETWORKS, made_run

from agents import pack
from agents.training.train_model import prepare
from jansen_env import paper_robot, sb3
from jansen_env.cli import evaluate, named_policies
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import check_action
from jansen_env.registration import IDS
from jansen_env.sb3.run_config import make_config
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import make_env, make_envs

SHIPPED = [(env_id, name) for env_id in IDS for name in pretrained.names(env_id)]
CRANK = "JansenCrank-v0"


def test_every_environment_has_its_policy():
    of_default = {env_id for env_id, name in SHIPPED if name == pretrained.DEFAULT}
    assert of_default == {*IDS}, "train.py trains the policy of a new task, agents.pack packs it"
    for path in (pretrained.shipped(*policy) for policy in SHIPPED):
        assert max(p.stat().st_size for p in path.parent.glob(f"{path.stem}.*")) < 650_000
    for name in ("none", f"../{CRANK}/ppo", None):
        with pytest.raises(ValueError, match=f"policy must be one of .*, got {name!r}"):
            pretrained.load(CRANK, name)
    known = re.escape(str(sorted(IDS)))
    for env_id in ("..", None, "JansenWalkr-v0"):
        with pytest.raises(ValueError, match=f"^env_id must be one of {known}, got {env_id!r}"):
            pretrained.load(env_id)


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "name"), SHIPPED)
def test_actions_are_the_networks(env_id, name):
    """They agree to 1e-6 in float64 anywhere, and to 1e-5 in torch's float32 where the policy comes
    by.
    """
    policy, model = pretrained.load(env_id, name), pack.load_sb3(env_id, name).policy
    envs = make_envs(env_id, policy.env_kwargs, 20)
    seen = envs.reset(seed=3)[0]
    acted = []
    for _ in range(100):
        actions, state = policy.predict(seen, "state")
        expected, _ = model.predict(seen, deterministic=True)
        assert state == "state"
        assert actions.dtype == np.float32 and actions.shape == (20, 1)
        assert np.abs(actions - expected).max() < 1e-5
        assert policy.predict(seen[3])[0] == pytest.approx(actions[3], abs=1e-7)
        acted.append(actions)
        seen = envs.step(actions)[0]
    envs.close()
    assert np.min(acted) >= -1.0 and np.max(acted) <= 1.0 and np.ptp(acted) > 0.01
    assert pack.check_equal(policy, model, 10_000) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "name"), SHIPPED)
def test_scores_are_those_shipped(env_id, name):
    """Equal on every machine; the ends of intervals are SciPy's, and rounded. If motions change on
    purpose, ``python -m agents.pack FILE.json --episodes N`` makes the scores again."""
    policy = pretrained.load(env_id, name)
    shipped = policy.description["scores"]
    scores = pack.scores_of(policy, shipped["episodes_per_command"], shipped["seed"])
    assert set(scores["overall"]) == set(find_benchmark(env_id).metrics)
    for metric, interval in scores["overall"].items():
        expected = shipped["overall"][metric]
        assert interval[0] == expected[0], metric
        assert interval[1:] == pytest.approx(expected[1:], rel=1e-9), metric
        values = scores["by_command"][metric]["value"]
        assert values == shipped["by_command"][metric]["value"], metric


def test_scores_can_be_made_again(made, tmp_path, capsys):
    path = shutil.copytree(made[1].parent, tmp_path / "copy") / "mine.json"
    before = json.loads(path.read_text())
    change(path, scores={})
    pack.main([str(path), "--episodes", "2", "--seed", "1"])
    assert f"written: {path}, with its scores" in capsys.readouterr().out
    after = pretrained.load_file(path).description
    assert after["scores"]["episodes_per_command"] == 2 and after["scores"]["seed"] == 1
    assert {**after, "scores": before["scores"]} == before
    with pytest.raises(SystemExit):
        pack.main([str(tmp_path / "other.json")])
    assert "other.json must contain a policy: " in capsys.readouterr().err


@pytest.mark.parametrize(("env_id", "name"), SHIPPED)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e39])
def test_observations_that_are_not_finite_are_refused(env_id, name, value):
    """The error names the column, and the row among many; 1e39 is infinite in float32."""
    policy = pretrained.load(env_id, name)
    width = len(policy.observed)
    for column, label in enumerate(policy.observed):
        seen = np.full((3, width), 0.5)
        seen[1, column] = value
        message = f"must be a finite number within float32's range, got {re.escape(str(value))}$"
        with pytest.raises(ValueError, match=f"^observation {label} {message}"):
            policy.predict(seen[1])
        with pytest.raises(ValueError, match=f"^observation {label} of row 1 {message}"):
            policy.predict(seen)


def test_columns_that_a_policy_does_not_observe_may_be_anything():
    policy = pretrained.load("JansenWalkerBuilt-v0")
    env = make_env("JansenWalkerBuilt-v0", {"height_scan": (0.0, 0.0, 1)})
    seen, _ = env.reset(seed=0)
    expected = policy.on(env).predict(seen)[0]
    scan = [entry.name for entry in env.unwrapped.observed].index("height_scan_0")
    seen[scan] = np.nan
    assert np.array_equal(policy.on(env).predict(seen)[0], expected)
    seen[0] = np.nan
    with pytest.raises(ValueError, match=r"^observation cos_crank_angle must"):
        policy.on(env).predict(seen)


def test_policies_need_neither_torch_nor_the_extra():
    code = f"""
import sys
from dataclasses import replace
from pathlib import Path
for name in ("torch", "stable_baselines3", "yaml", "imageio", "scipy", "agents"):
    sys.modules[name] = None
from jansen_env.policies import pretrained
for env_id in {sorted(IDS)}:
    policy = pretrained.load(env_id)
    action, _ = policy.predict([0.5] * len(policy.observed))
    assert action.shape == (1,)
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.mark.parametrize("env_id", ["JansenWalker-v0", CRANK])
def test_what_is_observed_is_what_is_documented(env_id):
    """Units and limits are those of the docstring's table, and names that ``info`` has mean the
    same.
    """
    env = make_env(env_id, {"height_scan": (0.0, 0.0, 1)} if env_id != CRANK else {})
    documented = inspect.getdoc(type(env.unwrapped)).split("## Observation Space")[1]
    rows = re.findall(r"^\| [\dn].*", documented.split("## ")[0], re.M)
    cells = [[cell.strip() for cell in row.split("|")[1:-1]] for row in rows]
    observed = env.unwrapped.observed
    loads = [entry for entry in observed if entry.name.startswith("toe_load")]
    assert len(observed) == len(cells) + max(0, len(loads) - 1)
    singles = [entry for entry in observed if entry not in loads[1:]]
    for entry, (_, _, low, high, unit) in zip(singles, cells, strict=True):
        assert (entry.unit, entry.low, entry.high) == (unit, float(low), float(high))
    space = env.observation_space
    assert [(e.low, e.high) for e in observed] == [*zip(space.low, space.high, strict=True)]
    env.reset(seed=0)
    for _ in range(20):
        seen, _, _, _, info = env.step(np.full(1, 0.3, np.float32))
    known = {e.name: value for e, value in zip(observed, seen, strict=True) if e.name in info}
    assert len(known) >= 3
    for name, value in known.items():
        assert value == pytest.approx(info[name], rel=1e-5), name


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packed")
    run = made_run(folder / "run", *NETWORKS["normalized"])
    return run, pack.pack(run, "mine", folder, episodes=1)


@pytest.mark.parametrize("network", NETWORKS)
def test_packing_keeps_the_policy(network, tmp_path):
    run = made_run(tmp_path / "run", *NETWORKS[network])
    path = pack.pack(run, None, tmp_path / "out", episodes=1)
    assert path == tmp_path / "out" / CRANK / f"{NETWORKS[network][0]}.json"
    policy, model = pretrained.load_file(path), sb3.load_policy(run)
    seen = np.random.default_rng(0).normal(size=(50, 5)).astype(np.float32)
    actions = policy.predict(seen)[0]
    expected = model.predict(seen, deterministic=True)[0]
    assert np.abs(actions - expected).max() < 1e-5
    assert np.ptp(actions) > 0.05
    again = pack.to_sb3(pretrained.load_file(path))
    for name, tensor in model.state_dict().items():
        assert torch.equal(tensor, again.policy.state_dict()[name]), name
    assert policy.description["training"]["command"] == ["python train.py --seed 0"]
    assert policy.env_kwargs == {"max_episode_steps": 50}


def test_training_starts_from_a_policy(made, tmp_path):
    """It has the weights of the policy and the noise of the new run; weights of another network are
    refused.
    """
    policy = pretrained.load_file(made[1])
    config = make_config(policy.description["training"]["config"])
    noisy = {**config.policy_kwargs, "log_std_init": -2.5}
    model = prepare(replace(config, policy_kwargs=noisy))
    pack.start_from(model, made[1])
    for name, array in policy.tensors.items():
        expected = np.full(1, -2.5, np.float32) if name == "log_std" else array
        started = model.policy.state_dict()[name].numpy()
        assert np.array_equal(started.ravel(), expected.ravel()), name
    other = prepare(replace(config, policy_kwargs={**config.policy_kwargs, "net_arch": [3]}))
    with pytest.raises(ValueError, match="the weights do not fit"):
        pack.start_from(other, made[1])


def test_what_cannot_be_packed_is_refused(made, tmp_path, capsys):
    run = shutil.copytree(made[0], tmp_path / "run")
    (run / "best_model.zip").unlink()
    for given in (run, tmp_path / "nowhere"):
        with pytest.raises(SystemExit):
            pack.main([str(given), "--out", str(tmp_path / "out")])
        assert "must be the file of a model" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def change(path, **values):
    """Change entries of a JSON file, ``a__b`` for b in a."""
    description = json.loads(path.read_text())
    for name, value in values.items():
        *parts, last = name.split("__")
        part = description
        for key in parts:
            part = part[int(key) if key.isdecimal() else key]
        part[last] = value
    path.write_text(json.dumps(description))


NAN = float("nan")
HARMONICS = {"kind": "harmonics", "multiples": [2]}


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (
            {"format": "jansen_env policy 2"},
            "format must be 'jansen_env policy 1', got 'jansen_env policy 2'",
        ),
        ({"history": {"length": 2}}, "an entry of the policy must be one of ["),
        ({"sha256": ""}, "sha256 must be that of mine.safetensors"),
        ({"action__torque_limit": NAN}, "torque_limit must be a finite number, got nan"),
        ({"network__features": []}, "network.features must have at least one number, got none"),
        ({"network__layers__0__weight": "os.system"}, "weight must be one of the tensors ["),
        ({"network__features__0__kind": "eval"}, "kind of features must be one of"),
        ({"network__features": [HARMONICS | {"multiples": [0.5]}]}, "got 0.5"),
        (
            {"network__features": [HARMONICS], "observation__0__name": "height"},
            "the first observations must be ['cos_crank_angle', 'sin_crank_angle'] for",
        ),
        ({"env__id": "os:system"}, "env.id must be one of ["),
        ({"action__torque_limit": 20.0}, "torque_limit must be 5.0"),
        (
            {"action__torque_limit": 1e300, "env__kwargs__torque_limit": 1e300},
            "torque_limit must be between 1.2e-38 and 3.4e+38, the range",
        ),
        (
            {"env__kwargs__time_step": 1e-6},
            "max_episode_steps must lead to at most 200000 time steps, got 50 with control_dt 0.01 "
            "and time_step 1e-06, which leads to 500000",
        ),
        (
            {"env__kwargs": {"control_dt": 1e-6, "time_step": 1e-9}, "action__control_dt": 1e-6},
            "control_dt must be between 0.0001 and 1.0, got 1e-06",
        ),
    ],
)
def test_descriptions_that_do_not_fit_are_refused(values, reason, made, tmp_path):
    path = shutil.copytree(made[1].parent, tmp_path / "copy") / "mine.json"
    change(path, **values)
    with pytest.raises(ValueError, match=re.escape(reason)) as error:
        pretrained.load_file(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("env_id", ["JansenWalkerBuilt-v0", CRANK])
@pytest.mark.parametrize(
    "env_kwargs",
    [{}, {"robot": "built", "torque_limit": 7.5}, {"motor": "ak80_6", "control_dt": 0.04}],
)
def test_actions_are_held_to_those_of_the_environment(env_id, env_kwargs):
    env = make_env(env_id, env_kwargs).unwrapped
    limit = env.torque_limit
    period = env.control_dt
    check_action(env_id, env_kwargs, limit, period)
    for wrong in ((1.01 * limit, period), (limit, 1.01 * period)):
        with pytest.raises(ValueError, match=f"must be .*, the value of {env_id} with env.kwargs"):
            check_action(env_id, env_kwargs, *wrong)


def test_a_policy_trains_where_it_walks(made, tmp_path):
    """A model of a file is of its own environment, not of another one in its configuration."""
    path = shutil.copytree(made[1].parent, tmp_path / "copy") / "mine.json"
    change(path, training__config__env_kwargs={"torque_limit": 20.0})
    with pytest.raises(
        ValueError, match=r"training\.config\.env_kwargs must be.*, got \{'torque_limit': 20\.0\}"
    ):
        pack.to_sb3(pretrained.load_file(path))


def test_damaged_files_are_refused(made, tmp_path):
    """Files are cut, too large, of other types, hold values that are not numbers, or are
    missing.
    """
    path = tmp_path / "mine.json"
    weights = tmp_path / "mine.safetensors"
    text, data = (p.read_bytes() for p in (made[1], made[1].with_suffix(".safetensors")))
    tensors = load(data)
    bias = "action_net.bias"
    variance = "pi_features_extractor.variance"
    spoilt = [
        (text[:-30], data),
        (b"[" * 10**5, data),
        (b"3", data),
        (text + b" " * pretrained.MAX_BYTES, data),
        (text, data + bytes(pretrained.MAX_BYTES)),
        (None, data),
        (text, None),
        (text, data[:300]),
        (text, (2**62).to_bytes(8, "little") + data[8:]),
        (text, save({**tensors, bias: np.full(1, np.nan, np.float32)})),
        (text, save({**tensors, bias: np.zeros(1)})),
        (text, save({**tensors, variance: -tensors[variance]})),
        (text, save({**tensors, bias: np.zeros(1, np.float32)})),
    ]
    for description, content in spoilt:
        for file, part in ((path, description), (weights, content)):
            file.unlink(missing_ok=True)
            if part is not None:
                file.write_bytes(part)
        with pytest.raises(ValueError, match=r"mine\.(json|safetensors)") as error:
            pretrained.load_file(path)
        assert "\n" not in str(error.value) and len(str(error.value)) < 400


@pytest.mark.parametrize("wrong", [np.zeros(20), np.zeros((2, 4)), np.zeros((1, 1, 5)), 0.0])
def test_observations_of_other_shapes_are_refused(wrong):
    with pytest.raises(ValueError, match=r"observation must have the shape \(5,\) or \(n, 5\)"):
        pretrained.load(CRANK).predict(wrong)


def test_evaluation_takes_shipped_and_packed_policies(made, tmp_path, monkeypatch):
    """They are taken by name and by path, beside a baseline."""
    monkeypatch.chdir(tmp_path)
    given = ["--policy", "pretrained", "--policy", str(made[1]), "--policy", "pid"]
    ((policies, env_kwargs),) = named_policies.load_all(evaluate.parse(["--env", CRANK, *given]))
    scores = evaluate.evaluate(policies, CRANK, env_kwargs, episodes=1)
    assert [*scores][::2] == ["pretrained", "pid"] and [*scores][1].endswith(f"{CRANK} mine")
    returns = [score["overall"]["return"][0] for score in scores.values()]
    assert returns[0] > returns[2] > returns[1]


def test_policies_of_other_observations_are_refused(made):
    for name, env_kwargs, reason in (
        (str(made[1]), {}, "must observe only numbers of this environment, ['cos_crank_angle', "),
        ("pretrained:sac", {}, "policy must be one of ['ppo'], got 'sac'"),
        ("pretrained", {"robot": paper_robot(3)}, "got a policy without toe_load_4"),
    ):
        with pytest.raises(ValueError, match=re.escape(reason)):
            named_policies.load_named(name, make_env("JansenWalker-v0", env_kwargs))


SPEEDS = (0.1, 0.2, 0.3, 0.5)  # m/s
LIMITS = {  # The unsupported fraction and the load, in weights, at these commands
    "ppo": ((0.06, 0.13, 0.2, 0.32), (2.5, 3.2, 4.0, 5.0)),
    "onboard": ((0.02, 0.05, 0.1), (2.0, 2.5, 3.0)),
    "economy": ((0.01, 0.02, 0.02, 0.05), (1.5, 2.0, 2.0, 2.0)),
    "stroller": ((0.01, 0.01, 0.01, 0.03), (1.5, 1.5, 1.5, 2.2)),
    "six_legs": ((0.03, 0.06, 0.1, 0.17), (2.2, 2.5, 3.0, 3.6)),
    "eight_legs": ((0.04, 0.06, 0.08, 0.12), (2.2, 2.5, 2.5, 2.5)),
    "twelve_legs": ((0.01, 0.01, 0.01, 0.01), (1.5, 1.5, 1.5, 1.5)),
}
"""Limits that docs/judging.md states for the policies of ``JansenWalkerBuilt-v0``."""


@pytest.mark.parametrize("name", LIMITS)
def test_the_page_states_the_limits(name):
    page = (Path(__file__).parents[2] / "docs" / "judging.md").read_text(encoding="utf-8")
    label = "pretrained" if name == pretrained.DEFAULT else f"pretrained:{name}"
    unsupported = ", ".join(f"{limit:.2f}" for limit in LIMITS[name][0])
    load = ", ".join(f"{limit:.1f}" for limit in LIMITS[name][1])
    rows = [line for line in page.splitlines() if line.startswith(f"| `{label}`")]
    assert any(f"| {unsupported} | {load} |" in row for row in rows), rows


@pytest.mark.parametrize("name", LIMITS)
def test_policies_walk_rather_than_hop(name):
    """The scores that come with the policies keep the limits; another test measures them again."""
    scores = pretrained.load("JansenWalkerBuilt-v0", name).description["scores"]["by_command"]
    for metric, limits in zip(("unsupported", "load"), LIMITS[name], strict=True):
        command = scores[metric]["command"]
        value = scores[metric]["value"]
        found = [value[command.index(speed)] for speed in SPEEDS[: len(limits)]]
        assert all(np.array(found) <= limits), (metric, found)
