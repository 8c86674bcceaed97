"""Studies: what is run, what goes on after a kill, and what is reported."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml

pytest.importorskip("ray", reason="Ray is not installed; the extra 'distributed' brings it")
from small_runs import same

from agents import study
from agents.studies import study_report
from agents.training.runs import FINAL
from jansen_env.sb3.trained import read_model
from jansen_env.scoring.benchmarks import find_benchmark

ROOT = Path(__file__).parents[2]
CRANK = "JansenCrank-v0"
VARIANT = {
    "hyperparameters": {"n_steps": 16, "batch_size": 64, "n_epochs": 1},
    "policy_kwargs": {"net_arch": [8]},
}
SMALL = {
    "seeds": 2, "envs": [CRANK], "timesteps": 3072, "n_envs": 4, "eval_freq": 1536,
    "save_freq": 512, "eval_episodes": 1, "env_kwargs": {"max_episode_steps": 16},
    "variants": {"small": VARIANT},
}  # fmt: skip


def start(plan, folder):
    """The study of a plan as a command in a process of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "small.yml").write_text(yaml.safe_dump(plan))
    with (folder / "out.txt").open("a") as out:
        return subprocess.Popen(
            [sys.executable, "-m", "agents.study", folder / "small.yml", "--log-folder", folder,
             "--workers", "2"],
            cwd=ROOT, stdout=out, stderr=subprocess.STDOUT,
        )  # fmt: skip


def rows_of(path):
    """The rows of a CSV file."""
    return [*csv.DictReader(path.read_text().splitlines())]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a finished study."""
    folder = tmp_path_factory.mktemp("studies")
    assert start(SMALL, folder).wait(400) == 0, (folder / "out.txt").read_text()
    return folder / "small"


def test_groups_are_variants_by_environments_by_algorithms():
    made = study.Study(
        seeds=[3, 1], envs=["JansenWalker-v0", CRANK], n_envs=8,
        variants={
            "plain": {}, "wide": {"policy_kwargs": {"net_arch": [32]}},
            "off-policy": {"env": "JansenWalker-v0", "algo": "sac", "n_envs": 2},
        },
    )  # fmt: skip
    groups = made.groups()
    assert list(groups) == [
        "JansenWalker-v0_ppo_plain", f"{CRANK}_ppo_plain", "JansenWalker-v0_ppo_wide",
        f"{CRANK}_ppo_wide", "JansenWalker-v0_sac_off-policy",
    ]  # fmt: skip
    wide, plain = groups["JansenWalker-v0_ppo_wide"], groups["JansenWalker-v0_ppo_plain"]
    assert wide.policy_kwargs == {**plain.policy_kwargs, "net_arch": [32]}
    assert groups["JansenWalker-v0_sac_off-policy"].n_envs == 2 and wide.n_envs == 8
    runs = made.runs()
    assert len(runs) == 10
    assert runs[0]["name"] == "JansenWalker-v0_ppo_plain-seed_3" and runs[0]["config"]["seed"] == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 1}, "'seed' is no key, must be in"),
        ({"seeds": 0}, "seeds is 0, must be a whole number from 1 to 10000, or a list"),
        ({"seeds": [1, 1]}, r"seeds is \[1, 1\], must be a list with each once"),
        ({"envs": [CRANK], "algos": ["sac"]}, f"no configuration for {CRANK}/sac"),
        ({"variants": {"a": {"hyperparameters": {"n_step": 1}}}},
         "_a: 'n_step' is no key of hyperparameters"),
        ({"variants": {}}, "variants is {}, must have one variant or more"),
        ({"variants": {"a/b": {}}}, "variants has the name 'a/b', must be a text of letters"),
        ({"variants": {"a": {"seed": 7}}}, "'seed' is no key of variant a, must be in"),
        ({"env_kwargs": {"speed": 1}}, "'speed' is no argument of JansenWalkerBuilt-v0"),
    ],
)  # fmt: skip
def test_a_plan_that_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=f"^plan.yml: .*{message}"):
        study.make_study(change, "plan.yml")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["plan.yml", "--seeds", "3"], "not allowed beside it: seeds"),
        (["no.yml"], "no.yml cannot be read"),
        (["--report", "nowhere"], "nowhere/study.yml cannot be read"),
    ],
)
def test_arguments_are_refused(given, message, capsys):
    with pytest.raises(SystemExit):
        study.main(given)
    assert message in capsys.readouterr().err.splitlines()[0]


def test_the_shipped_study_can_be_run():
    made = study.make_study(study.read_yaml(ROOT / "agents" / "studies" / "ten_seeds.yml"), "it")
    assert len(made.groups()) == 2 and made.seeds == [*range(1, 11)]


def test_report_has_the_numbers_of_the_runs(finished, tmp_path):
    folder = shutil.copytree(finished, tmp_path / "copy")
    table = study_report.write_report(folder)
    rows = [row for row in rows_of(folder / "runs.csv") if row["policy"] == "run"]
    assert [row["seed"] for row in rows] == ["0", "1"] and f"{CRANK}_ppo_small" in table
    for row in rows:
        (path,) = folder.glob(f"*-seed_{row['seed']}/scores.json")
        *_, scores = json.loads(path.read_text()).values()
        assert float(row["return"]) == scores["overall"]["return"][0]
    returns = [float(row["return"]) for row in rows]
    assert f"| {np.mean(returns):.3g} [" in table
    assert f"{min(returns):.3g} (seed {np.argmin(returns)})" in table
    assert len(rows_of(folder / "commands.csv")) == 2 * (1 + len(find_benchmark(CRANK).baselines))
    report = (folder / "report.md").read_text()
    assert all(f"| {name} " in report for name in find_benchmark(CRANK).baselines)
    assert (folder / f"{CRANK}.png").stat().st_size > 10_000


def test_another_study_in_the_same_folder_is_refused(finished):
    other = study.make_study({**SMALL, "seeds": 3}, "it")
    with pytest.raises(ValueError, match="holds another study, must be another --name"):
        study.run_study(other, finished, study.parse([]))


def test_an_address_without_a_cluster_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        study.main(["--seeds", "1", "--log-folder", str(tmp_path), "--address", "127.0.0.1:1"])
    assert "refused" in capsys.readouterr().err.splitlines()[0]
    assert not [*tmp_path.rglob(study.PLAN)]  # so the command can be given again, corrected


def test_a_study_without_a_finished_run_is_reported(tmp_path):
    assert study_report.write_report(tmp_path) == "no run is finished"


def test_statistics_are_over_runs():
    ten = np.array([3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0, 3.5, 8.0, 9.7])
    middle = [2.6, 3.0, 3.5, 4.0, 5.0, 8.0]
    value, low, high = study_report.with_interval(study_report.interquartile_mean, ten)
    assert value == pytest.approx(np.mean(middle)) and low < value < high
    half = 4.302652729911275 * np.sqrt(7.0 / 3.0)  # Student's, with two degrees of freedom
    found = study_report.mean_with_interval(np.array([1.0, 2.0, 6.0]))
    assert found == pytest.approx((3.0, 3.0 - half, 3.0 + half))
    assert np.isnan(study_report.mean_with_interval(np.array([2.0]))[1:]).all()
    better = study_report.improvement(np.array([5.0, 6.0, 3.0, 0.0]), np.array([3.0, 1.0]))
    assert better == (2 + 2 + 1.5 + 0) / 8


def test_a_killed_study_goes_on(finished, tmp_path):
    """Kill -9 of Ray's workers and of the driver; in the end the weights are those of an untroubled
    study, bit for bit."""
    killed, driver = tmp_path, start(SMALL, tmp_path)
    for victims in ("workers", "driver"):
        before = {*killed.glob("small/*/checkpoints/model_*_steps.zip")}
        end = time.monotonic() + 120.0
        while len({*killed.glob("small/*/checkpoints/model_*_steps.zip")} - before) < 2:
            assert driver.poll() is None and time.monotonic() < end, (
                killed / "out.txt"
            ).read_text()
            time.sleep(0.05)
        children = psutil.Process(driver.pid).children(recursive=True)
        workers = [child for child in children if "ImplicitFunc" in " ".join(child.cmdline())]
        assert workers
        for process in workers if victims == "workers" else [psutil.Process(driver.pid)]:
            os.kill(process.pid, signal.SIGKILL)
    driver.wait()
    assert not psutil.wait_procs(workers, timeout=60)[1]  # whose runs would go on meanwhile
    again = start(SMALL, killed)
    assert again.wait(400) == 0, (killed / "out.txt").read_text()
    for path in finished.glob(f"*/{FINAL}"):
        other = killed / "small" / path.parent.name / FINAL
        assert same(read_model(path)[:3], read_model(other)[:3])
