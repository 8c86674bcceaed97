"""Studies: what is run, in which folder, what goes on after a kill, and what is reported."""

import csv
import io
import json
import os
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from small_studies import (
    ROOT,
    SMALL,
    assert_same_results,
    command,
    output,
    perform_here,
    running,
    start,
    wait_until,
)

from agents import study
from agents.studies import plan as study_plan
from agents.studies import run as study_run
from agents.studies import study_report
from agents.studies.plan import make_study
from agents.training.runs import locked
from jansen_env.plain_yaml import read_yaml
from jansen_env.scoring.benchmarks import BENCHMARKS


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A study's folder, its runs performed one after another in this process."""
    folder = tmp_path_factory.mktemp("studies") / "small"
    _, outcomes = perform_here(SMALL, folder)
    assert [outcome.state for outcome in outcomes] == ["finished"] * 4, outcomes
    return folder


def test_groups_are_variants_by_environments_by_algorithms():
    made = make_study({
        "seeds": [3, 1], "envs": ["JansenWalker-v0", "JansenCrank-v0"], "n_envs": 8,
        "variants": {
            "plain": {}, "wide": {"policy_kwargs": {"net_arch": [32]}},
            "off-policy": {"env": "JansenWalker-v0", "algo": "sac", "n_envs": 2},
        },
    })  # fmt: skip
    assert list(made.groups) == [
        "JansenWalker-v0_ppo_plain", "JansenCrank-v0_ppo_plain", "JansenWalker-v0_ppo_wide",
        "JansenCrank-v0_ppo_wide", "JansenWalker-v0_sac_off-policy",
    ]  # fmt: skip
    wide = made.groups["JansenWalker-v0_ppo_wide"]
    assert wide["policy_kwargs"] == {
        **made.groups["JansenWalker-v0_ppo_plain"]["policy_kwargs"], "net_arch": [32],
    }  # fmt: skip
    assert made.groups["JansenWalker-v0_sac_off-policy"]["n_envs"] == 2
    assert wide["n_envs"] == 8 and "seed" not in wide
    runs = made.runs(Path("logs"))
    assert len(runs) == 10
    assert runs[0].name == "JansenWalker-v0_ppo_plain/seed_3" and runs[0].config["seed"] == 3
    assert runs[0].folder == Path("logs/JansenWalker-v0_ppo_plain/seed_3")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 1}, "'seed' is no key, must be in"),
        ({"seeds": 0}, "seeds is 0, must be a whole number from 1 to 10000, or a list"),
        ({"seeds": [1, 1]}, r"seeds is \[1, 1\], must be a list with each once"),
        ({"algos": ["dqn"]}, "algos is 'dqn', must be one of"),
        ({"envs": ["JansenCrank-v0"], "algos": ["sac"]}, "no configuration for JansenCrank-v0/sac"),
        ({"variants": {"a/b": {}}}, "variant is 'a/b', must be of letters"),
        ({"variants": {"a": {"hyperparameters": {"n_step": 1}}}},
         "_a: 'n_step' is no key of hyperparameters"),
        ({"env_kwargs": {"speed": 1}}, "'speed' is no argument of JansenWalkerBuilt-v0"),
        ({"seeds": 10_000, "envs": ["JansenWalker-v0", "JansenCrank-v0"]}, "1 to 10000 runs"),
    ],
)  # fmt: skip
def test_a_plan_that_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        make_study(change, "plan.yml")


def test_the_shipped_study_can_be_run():
    made = make_study(read_yaml(ROOT / "agents" / "studies" / "ten_seeds.yml"))
    assert len(made.groups) == 2 and made.seeds == [*range(1, 11)]


def test_another_study_in_the_same_folder_is_refused(tmp_path):
    study_plan.enter(tmp_path, make_study(SMALL))
    study_plan.enter(tmp_path, make_study(SMALL))
    assert study_plan.read_study(tmp_path) == make_study(SMALL)
    other = make_study({**SMALL, "seeds": 3, "timesteps": 1024})
    with pytest.raises(ValueError, match=r"holds another study: seeds is \[0, 1, 2\], there") as e:
        study_plan.enter(tmp_path, other)
    assert "groups.JansenCrank-v0_ppo_plain.timesteps is 1024, there 512" in str(e.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seeds: [0]", "must be a mapping with"),
        ("{seeds: [0], groups: {../a: {}}, eval_freq: 0, save_freq: 0, eval_episodes: 1}",
         "group is '../a', must be of letters"),
        ("[", "study.yml"),
    ],
)  # fmt: skip
def test_a_folder_whose_study_is_damaged_is_refused(tmp_path, text, message):
    (tmp_path / study_plan.PLAN).write_text(text)
    with pytest.raises(ValueError, match=message):
        study_plan.read_study(tmp_path)


def test_finished_runs_are_recognised_and_reported(finished, tmp_path, capsys):
    """The same command trains nothing, and reports; --report does without the command."""
    shutil.copytree(finished, tmp_path / "small")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*model*.zip")}
    arguments = command(SMALL, tmp_path)[2:]
    assert study.main([*arguments, "--local"]) == 0
    shown = capsys.readouterr().out
    assert "4 runs, 4 finished, 0 to do" in shown
    assert {path: path.read_bytes() for path in tmp_path.rglob("*model*.zip")} == before
    (tmp_path / "small" / "report.md").unlink()
    assert study.main(["--report", str(tmp_path / "small")]) == 0
    assert capsys.readouterr().out.strip() in shown
    assert (tmp_path / "small" / "report.md").is_file()
    assert (tmp_path / "small" / "JansenCrank-v0.png").stat().st_size > 10_000


def test_report_has_the_numbers_of_the_runs(finished, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(finished, folder)
    made = study_plan.read_study(folder)
    table = study_report.write_report(made, folder)
    rows = list(csv.DictReader((folder / "runs.csv").read_text().splitlines()))
    found = json.loads((folder / "report.json").read_text())
    assert len(rows) == 4
    for row, run in zip(rows, made.runs(folder), strict=True):
        scores = json.loads((run.folder / "scores.json").read_text())
        own = list(scores.values())[-1]["overall"]["return"][0]
        assert float(row["return"]) == own
    for name, group in found["groups"].items():
        own = [float(row["return"]) for row in rows if row["group"] == name]
        assert group["returns"] == own and group["mean"][0] == pytest.approx(np.mean(own))
        worst = min((row for row in rows if row["group"] == name), key=lambda r: float(r["return"]))
        assert group["worst"] == {"return": min(own), "seed": int(worst["seed"])}
        torques = [float(row["rms_torque"]) for row in rows if row["group"] == name]
        assert group["metrics"]["rms_torque"][0] == pytest.approx(np.mean(torques))
    raw = list(csv.DictReader((folder / "commands.csv").read_text().splitlines()))
    assert len(raw) == 4 + 2 * len(BENCHMARKS["JansenCrank-v0"].baselines)  # of one command each
    for row in rows:
        (own,) = [r for r in raw if (r["group"], r["seed"]) == (row["group"], row["seed"])]
        assert (own["policy"], float(own["command"])) == ("run", 1.0)
        assert float(own["return"]) == float(row["return"])
        assert group["curve"]["steps"] == [256.0, 512.0]
        assert name in table
    assert [interval[0] for others in found["improvement"].values() for interval in others.values()]


def test_a_study_without_a_finished_run_is_reported(tmp_path):
    """As one that was stopped early."""
    text = study_report.write_report(make_study(SMALL), tmp_path)
    assert "0/2" in text and "_plain/seed_0: waiting" in text


def test_a_failed_run_does_not_stop_the_others(tmp_path, monkeypatch):
    from agents.training import train_model as training

    whole = training.train

    def diverges(model, config, folder, **given):
        if config["seed"] == 0:
            raise SystemExit("training diverged at 7 steps")
        whole(model, config, folder, **given)

    monkeypatch.setattr(training, "train", diverges)
    plan = {**SMALL, "variants": {"plain": SMALL["variants"]["plain"]}}
    made, outcomes = perform_here(plan, tmp_path)
    assert [outcome.state for outcome in outcomes] == ["failed", "finished"]
    text = study_report.write_report(made, tmp_path)
    assert "JansenCrank-v0_ppo_plain/seed_0: failed, training diverged at 7 steps" in text
    assert "1/2" in text
    monkeypatch.undo()
    _, outcomes = perform_here(plan, tmp_path)
    assert [outcome.state for outcome in outcomes] == ["finished", "finished"]
    assert "Not finished" not in study_report.write_report(made, tmp_path)


def test_a_folder_that_is_not_shared_is_refused(finished):
    run = study_plan.read_study(finished).runs(finished)[0]
    request = study_run.RunRequest(run, 0, 0, 1, 1, "python", "of another folder")
    outcome = study_run.execute_run(request)
    assert outcome.state == "failed" and "all machines must share this folder" in outcome.error


def test_a_run_that_another_process_has_is_not_touched(finished, monkeypatch):
    monkeypatch.setattr(study_run, "PATIENCE", 0.0)
    run = study_plan.read_study(finished).runs(finished)[0]
    with locked(run.folder):
        outcome = study_run.execute_run(study_run.RunRequest(run, 0, 0, 1, 1, "python", "here"))
    assert outcome.state == "failed" and "is in use by" in outcome.error
    assert study_run.read_status(run.folder)["state"] == "finished"


def test_progress_is_a_bar_in_a_terminal_and_lines_elsewhere(finished):
    runs = study_plan.read_study(finished).runs(finished)
    results = {runs[0].name: study_run.RunResult("failed", "diverged")}
    for terminal in (True, False):
        console = Console(file=io.StringIO(), force_terminal=terminal, width=120, height=30)
        with study.study_progress(runs, console) as progress:
            progress(results)
            progress(results)
        shown = console.file.getvalue()
        times = shown.count("1 failed, 3 finished")
        assert times >= 1 if terminal else times == 1  # a line where something changes
        assert ("2048/2048" in shown) == terminal


def test_an_address_without_ray_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(SystemExit, match="--address needs ray, which the extra 'distributed'"):
        study.main(["--address", "x"])


@pytest.mark.slow
def test_local_processes_give_the_same_runs(finished, tmp_path):
    process = start(command(SMALL, tmp_path, "--local", "--workers", "2", "--cores", "2"))
    assert process.wait(300) == 0, output(process)
    assert_same_results(finished, tmp_path / "small")


@pytest.mark.slow
def test_killed_driver_and_worker_lose_nothing(tmp_path):
    """Kill -9 of a worker is made good; of the driver by the same command: same weights, scores."""
    plan = {**SMALL, "seeds": 1, "timesteps": 4096, "save_freq": 256, "eval_freq": 2048}
    perform_here(plan, tmp_path / "whole")
    arguments = command(plan, tmp_path / "killed", "--local", "--workers", "1")
    driver = start(arguments)
    folders = [run.folder for run in make_study(plan).runs(tmp_path / "killed" / "small")]
    wait_for_checkpoint(folders[0], 512, driver)
    worker = study_run.read_status(folders[0])["pid"]
    os.kill(worker, signal.SIGKILL)
    wait_for_checkpoint(folders[1], 512, driver)
    worker = study_run.read_status(folders[1])["pid"]
    driver.kill()
    driver.wait()
    wait_until(lambda: not running(worker))
    again = start(arguments)
    assert again.wait(300) == 0, output(again)
    shown = output(again)
    assert "2 runs, 1 finished, 1 to do" in shown
    assert_same_results(tmp_path / "whole", tmp_path / "killed" / "small")


@pytest.mark.slow
def test_an_end_by_signal_saves_checkpoints(tmp_path):
    """SIGTERM is taken as Ctrl-C, and is never ignored as that is in a shell's background."""
    plan = {**SMALL, "timesteps": 1_000_000, "save_freq": 0, "eval_freq": 0}
    driver = start(command(plan, tmp_path, "--local", "--workers", "2"))
    folders = [run.folder for run in make_study(plan).runs(tmp_path / "small")]
    wait_until(lambda: all(map(is_training, folders[:2])), driver)
    driver.send_signal(signal.SIGTERM)
    assert driver.wait(60) == 130, output(driver)
    for folder in folders[:2]:
        assert len(list((folder / "checkpoints").glob("model_*_steps.zip"))) == 1
        assert study_run.read_status(folder)["state"] == "stopped"
    assert not folders[2].exists()


def is_training(folder):
    """Whether a run is in the midst of training: Stable-Baselines3 has begun its log."""
    return any(folder.glob("tensorboard/*/events*"))


def wait_for_checkpoint(folder, steps, driver):
    """Until a run of a driver has saved one of so many steps or more."""
    wait_until(
        lambda: any(
            int(path.stem.split("_")[1]) >= steps
            for path in (folder / "checkpoints").glob("model_*_steps.zip")
        ),
        driver,
    )
