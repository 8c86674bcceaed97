"""Search hyperparameters with Optuna, of the extra `tune`, which ends poor trials early.

python examples/tune_with_optuna.py [TRIALS] [STEPS]   (16 of 800,000 by default: half an hour)
"""

import sys
from dataclasses import asdict
from pathlib import Path

import optuna
import yaml
from stable_baselines3.common.callbacks import BaseCallback

from agents.training.config import new_config
from agents.training.runs import read_evaluations, record_run
from agents.training.train_model import prepare, train

trials, steps = (int(text) for text in (sys.argv[1:] + ["16", "800000"][len(sys.argv) - 1 :]))


class Pruning(BaseCallback):
    def __init__(self, trial: optuna.Trial, folder: Path) -> None:
        super().__init__()
        self.trial, self.folder, self.seen = trial, folder, 0

    def _on_rollout_start(self) -> None:
        rows = read_evaluations(self.folder)
        if len(rows) > self.seen:
            self.seen = len(rows)
            self.trial.report(rows[-1]["return"], self.seen)
            if self.trial.should_prune():  # below the median of the trials before
                raise optuna.TrialPruned

    def _on_step(self) -> bool:
        return True


def objective(trial: optuna.Trial) -> float:
    folder = Path("tune") / str(trial.number)
    rate = trial.suggest_float("learning_rate", 1e-4, 2e-3, log=True)
    epochs = trial.suggest_int("n_epochs", 3, 12)
    units = trial.suggest_categorical("units", [32, 64, 128])
    searched = {"learning_rate": f"linear_{rate:.3g}", "n_epochs": epochs}
    network = {"net_arch": [units, units]}
    config = new_config(timesteps=steps, hyperparameters=searched, policy_kwargs=network)
    record_run(folder, config, "tune_with_optuna.py")
    rollout = config.n_envs * config.hyperparameters["n_steps"]  # no use looking more often
    train(prepare(config), config, folder, eval_every=max(steps // 8, rollout), save_every=0,
          progress=False, more_callbacks=[Pruning(trial, folder)])  # fmt: skip
    trial.set_user_attr("config", asdict(config))
    return max(row["return"] for row in read_evaluations(folder))


study = optuna.create_study(
    storage="sqlite:///tune.db", study_name="ppo", direction="maximize", load_if_exists=True
)
study.optimize(objective, n_trials=max(trials - len(study.trials), 0))
Path("best.yml").write_text(yaml.safe_dump(study.best_trial.user_attrs["config"]))
print(f"best return {study.best_value:.0f}, for train.py --config best.yml: {study.best_params}")
