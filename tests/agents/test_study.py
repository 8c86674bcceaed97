"""Studies: what is run, what goes on after a kill, and what is reported."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import psutil
import pytest
import yaml

pytest.importorskip("ray", reason="Ray is not installed; the group 'distributed' brings it")
from small_runs import LIBRARY, same

from agents import study, study_report
from agents.training.runs import FINAL
from jansen_env.sb3.trained import read_model
from jansen_env.scoring.benchmarks import find_benchmark

ROOT = Path(__file__).parents[2]
CRANK = "JansenCrank-v0"
CONFIG = {
    "algo": "ppo",
    "hyperparameters": {"n_steps": 16, "batch_size": 64, "n_epochs": 1},
    "policy_kwargs": {"net_arch": [8]},
}
SMALL = {
    "seeds": 2,
    "env": [CRANK],
    "timesteps": 3072,
    "n_envs": 4,
    "eval_freq": 1536,
    "save_freq": 512,
    "eval_episodes": 1,
    "env_kwargs": {"max_episode_steps": 16},
}


def start(plan, folder):
    """The study of a plan as a command in a process of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    config = folder / "config.yml"
    config.write_text(yaml.safe_dump(CONFIG))
    (folder / "small.yml").write_text(yaml.safe_dump({**plan, "config": str(config)}))
    arguments = [folder / "small.yml", "--log-folder", folder, "--workers", "2"]
    with (folder / "out.txt").open("a") as out:
        return subprocess.Popen(
            [sys.executable, "-m", "agents.study", *arguments],
            cwd=ROOT,
            stdout=out,
            stderr=subprocess.STDOUT,
        )


def rows_of(path):
    """The rows of a CSV file."""
    return [*csv.DictReader(path.read_text().splitlines())]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a study that went on after kill -9 of Ray's workers and of the driver."""
    folder = tmp_path_factory.mktemp("studies")
    driver = start(SMALL, folder)
    for victims in ("workers", "driver"):
        before = {*folder.glob("small/*/checkpoints/model_*_steps.zip")}
        end = time.monotonic() + 120.0
        while len({*folder.glob("small/*/checkpoints/model_*_steps.zip")} - before) < 2:
            printed = (folder / "out.txt").read_text()
            assert driver.poll() is None and time.monotonic() < end, printed
            time.sleep(0.05)
        children = psutil.Process(driver.pid).children(recursive=True)
        workers = [child for child in children if "ImplicitFunc" in " ".join(child.cmdline())]
        assert workers
        for process in workers if victims == "workers" else [psutil.Process(driver.pid)]:
            os.kill(process.pid, signal.SIGKILL)
    driver.wait()
    assert not psutil.wait_procs(workers, timeout=60)[1]  # whose runs would go on meanwhile
    assert start(SMALL, folder).wait(400) == 0, (folder / "out.txt").read_text()
    return folder / "small"


def test_runs_are_environments_by_algorithms_by_seeds(tmp_path):
    plan = tmp_path / "two.yml"
    plan.write_text("{env: [JansenWalker-v0], algo: [ppo, sac], first_seed: 3, n_envs: 8}")
    runs = study.planned_runs(study.parse([str(plan), "--seeds", "2"]))
    groups = ["JansenWalker-v0_ppo", "JansenWalker-v0_sac"]
    assert [run["name"] for run in runs] == [f"{g}-seed_{seed}" for seed in (3, 4) for g in groups]
    assert runs[3]["config"]["algo"] == "sac" and runs[3]["config"]["seed"] == 4
    assert {run["config"]["n_envs"] for run in runs} == {8}


def test_of_several_configurations_each_is_a_group():
    """The shipped configuration is used only for algorithms that have one."""
    where = ["--env", "JansenWalkerRough-v0", "--config", str(LIBRARY), "shipped"]
    plan = [*where, "--algo", "ppo", "ars", "--seeds", "1"]
    runs = study.planned_runs(study.parse(plan))
    names = [run["name"].removesuffix("-seed_0").partition("_")[2] for run in runs]
    assert names == ["ppo_library", "ppo_shipped", "ars_library"]
    assert [run["config"]["n_envs"] for run in runs] == [16, 512, 16]


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ("seed: 1", "unrecognized arguments: --seed 1"),
        ("seeds: [1, 2]", "unrecognized arguments: 2"),
        ("seeds: 0", "argument --seeds: must be a whole number from 1 to"),
        (f"{{env: [{CRANK}], algo: [sac]}}", f"configuration must be .*, got '{CRANK}/sac'"),
        (
            "env_kwargs: {speed: 1}",
            r"must be one of \[.*, got 'speed'",
        ),
        ("[1]", r"must be a dict.*, got \[1\]"),
        (None, "no.yml cannot be read"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(plan, message, tmp_path, capsys):
    file = tmp_path / "no.yml"
    if plan:
        file.write_text(plan)
    with pytest.raises(SystemExit):
        study.main([str(file), "--log-folder", str(tmp_path)])
    assert re.search(message, capsys.readouterr().err.splitlines()[0])


def test_the_shipped_studies_can_be_run():
    for file in (ROOT / "agents" / "studies").glob("*.yml"):
        runs = study.planned_runs(study.parse([str(file)]))
        assert {run["config"]["seed"] for run in runs} == {*range(1, 11)}


def test_report_has_the_numbers_of_the_runs(finished, tmp_path):
    folder = shutil.copytree(finished, tmp_path / "copy")
    table = study.write_report(folder)
    rows = rows_of(folder / "runs.csv")
    overall = [row for row in rows if row["policy"] == "run" and not row["command"]]
    assert [row["seed"] for row in overall] == ["0", "1"] and f"| {CRANK}_ppo " in table
    for row in overall:
        (path,) = folder.glob(f"*-seed_{row['seed']}/scores.json")
        *_, scores = json.loads(path.read_text()).values()
        assert float(row["return"]) == scores["overall"]["return"][0]
        assert row.keys() > scores["by_command"].keys()
    returns = [float(row["return"]) for row in overall]
    assert f"| {np.mean(returns):.3g} " in table
    assert f"{min(returns):.3g} (seed {np.argmin(returns)})" in table
    benchmark = find_benchmark(CRANK)
    assert len(rows) == 2 * (1 + len(benchmark.baselines)) * (1 + len(benchmark.commands))
    report = (folder / "report.md").read_text()
    assert all(f": {name} " in report for name in benchmark.baselines)
    assert (folder / f"{CRANK}.png").stat().st_size > 10_000
    alone = tmp_path / "alone"
    alone.mkdir()
    kept = shutil.copy(folder / "returns.csv", alone)
    assert study.write_report(alone) == table
    threshold = f"{gym.spec(CRANK).reward_threshold}\n"
    goal = (alone / "returns.csv").read_text().replace(CRANK, "JansenGoal-v0").partition("\n")[2]
    with Path(kept).open("a") as file:
        file.write(goal.replace(threshold, "1.0\n"))  # so that the mean is dominated by this one
    merged = study.write_report(alone)
    assert "| JansenGoal-v0_ppo " in merged
    shares = np.concatenate([np.array(returns) / float(threshold), returns])
    row = next(line for line in merged.splitlines() if "ppo, / threshold" in line)
    assert f"| {shares.mean():.3g} " in row and row.split("|")[2].strip() == "4"


def test_the_page_is_the_report_of_its_data(tmp_path):
    """On the page, an introduction replaces the heading of the report."""
    shipped = ROOT / "docs" / "training" / "algorithms"
    folder = tmp_path / "algorithms"
    folder.mkdir()
    shutil.copy(shipped / "returns.csv", folder)
    study.write_report(folder)
    _, _, report = (folder / "report.md").read_text().partition("\n\n")
    assert report.startswith("| group ")
    assert (shipped / "report.md").read_text().endswith("\n\n" + report)


def test_another_study_in_the_same_folder_is_refused(finished):
    with pytest.raises(ValueError, match="contains another study; choose another --name"):
        study.run_study(study.parse(["--seeds", "3"]), finished)


def test_a_finished_study_is_not_run_again(finished):
    assert study.run_study(study.parse([str(finished.parent / "small.yml")]), finished)
    assert not study.ray.is_initialized()


def test_a_run_of_another_configuration_is_neither_reported_nor_gone_on_with(finished, monkeypatch):
    """Such a run is left over when the file that the plan names has changed since."""
    args = study.parse([str(finished.parent / "small.yml")])
    runs = study.planned_runs(args)
    runs[0]["config"]["n_envs"] = 8
    monkeypatch.setattr(study, "planned_runs", lambda _: runs)
    with pytest.raises(ValueError, match="belongs to another configuration; choose"):
        study.run_study(args, finished)


def test_an_address_without_a_cluster_is_refused(tmp_path, capsys):
    for address in ("127.0.0.1:1", "127.0.0.1:port", "127.0.0.1:70000"):
        with pytest.raises(SystemExit) as ended:
            study.main(["--seeds", "1", "--log-folder", str(tmp_path), "--address", address])
        assert ended.value.code == 2
        assert f"must be HOST:PORT of a Ray cluster, got '{address}'" in capsys.readouterr().err
    assert not [*tmp_path.rglob(study.PLAN)]  # so the command can be given again, corrected


def test_a_report_of_no_run_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        study.main(["--report", "--log-folder", str(tmp_path)])
    assert "must contain a finished run" in capsys.readouterr().err


def test_intervals_are_over_runs():
    ten = np.array([3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0, 3.5, 8.0, 9.7])
    value, low, high = study_report.interquartile_mean(ten)
    assert value == pytest.approx(np.mean([2.6, 3.0, 3.5, 4.0, 5.0, 8.0])) and low < value < high
    assert study_report.interquartile_mean(ten[:1])[0] == 3.0
    assert np.isnan(study_report.interquartile_mean(ten[:1])[1:]).all()
    apart = study_report.interquartile_mean(np.full(4, 1.0), np.full(4, 3.0))  # drawn in each alone
    assert apart == (2.0, 2.0, 2.0)


def test_a_killed_study_goes_on(finished, tmp_path):
    """In the end its weights are those of runs that nobody killed, bit for bit."""
    runs = study.planned_runs(study.parse([str(finished.parent / "small.yml")]))
    for run in runs:
        study.run_trial({"run": run}, SMALL, tmp_path)
        ours, other = (read_model(folder / run["name"] / FINAL) for folder in (finished, tmp_path))
        assert same(ours[:3], other[:3])
    assert len(runs) == 2
