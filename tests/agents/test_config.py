"""Configurations and arguments: read as plain data, checked, and refused in one line."""

import argparse
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import train
from agents.training import config
from jansen_env.cli import flags, named_policies
from jansen_env.files.plain_yaml import read_yaml
from jansen_env.sb3.run_config import RunConfig, load_config


def written(folder, **values):
    """A configuration file with these values."""
    path = folder / "config.yml"
    path.write_text(yaml.safe_dump(values))
    return path


def one_line(error):
    """What an exception says, which has to be one line."""
    text = str(error.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: 1\nb: 2\na: 3", "line 3: a key must be a text that occurs only once, got 'a'"),
        ("a: &x [1, 2]\nb: *x", "line 2: aliases are not allowed"),
        ("{a: &a [x, x], b: [*a, *a], c: [*b, *b]}", "aliases are not allowed"),
        ("a: !!python/object/apply:os.getcwd []", "line 1: could not determine a constructor"),
        ("? [1]\n: 2", "line 1: a key must be a text"),
        ("a: [1", "line 1: "),
        ("--- 1\n--- 2", "another document"),
        ("a: \x01", "special characters"),
        ("[" * 6_000, "not valid YAML"),
    ],
)
def test_yaml_that_is_no_plain_data(text, reason, tmp_path):
    """It is refused in one line that names file and place, in files and on the command line."""
    path = tmp_path / "x.yml"
    path.write_text(text)
    with pytest.raises(ValueError, match=reason) as error:
        read_yaml(path)
    assert str(path) in one_line(error)
    with pytest.raises(argparse.ArgumentTypeError, match=reason):
        flags.mapping(text)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"timesteps": -1}, "timesteps must be a whole number from 1 to 10000000000, got -1"),
        ({"timesteps": "9" * 5000}, "timesteps must be .*, got '99999"),
        ({"timesteps": True}, "timesteps must be.*got True"),
        ({"reward_scale": 0}, "reward_scale must be a number from 1e-30.*got 0"),
        ({"hyperparameters": None}, "hyperparameters must be a mapping.*got None"),
        ({"training_variants": [1]}, r"training_variants must be a list of mappings, got \[1\]"),
        ({"policy": "os.path"}, "policy must be one of.*got 'os.path'"),
        ({"env": "os:X-v0"}, "env must be one of.*got 'os:X-v0'"),
        ({"other": 1}, "a key must be one of .*, got 'other'"),
        ({"training_variants": [{"entry_point": "os:x"}]}, r"one of \[.*, got 'entry_point'"),
        (
            {"policy_kwargs": {"features_extractor_class": "os.x"}},
            "a key of policy_kwargs must be one of .*, got 'features_extractor_class'",
        ),
        ({"policy_kwargs": {"activation": "os.x"}}, "policy_kwargs.activation must be.*got 'os.x'"),
        ({"policy_kwargs": {"net_arch": [10**9]}}, r"net_arch must be.*got \[1000000000\]"),
        ({"policy_kwargs": {"net_arch": [1] * 99}}, "must be a list of up to 8 layers"),
        ({"policy_kwargs": {"net_arch": {"pi": [8], "qf": [8]}}}, r"mapping of \['pi', 'vf'\]"),
        ({"policy_kwargs": {"harmonics": 4}}, "normalize must be true with harmonics, got False"),
        (
            {"policy_kwargs": {"half_turn": True}},
            "normalize must be true with half_turn, got False",
        ),
        *(
            ({"hyperparameters": {name: value}}, message)
            for name, value, message in (
                ("learning_rate", -1e-3, "from 1e-30 to 1e.30, or 'linear_NUMBER'"),
                ("clip_range", "linear_0", "clip_range must be a number.*got 'linear_0'"),
                ("gamma", float("nan"), "gamma must be a number from 0 to 1, got nan"),
                ("n_epochs", 2.5, "n_epochs must be a whole number.*got 2.5"),
                ("target_kl", 0, "must be a number from 1e-30 to 1e.30, or null"),
                ("use_sde", "yes", "use_sde must be true or false, got 'yes'"),
                (
                    "rollout_buffer_class",
                    "os.x",
                    "a key of .* must be one of .*, got 'rollout_buffer_class'",
                ),
            )
        ),
    ],
)
def test_values_are_checked(values, message, tmp_path):
    path = written(tmp_path, **values)
    with pytest.raises(ValueError, match=message) as error:
        load_config(path)
    assert one_line(error).startswith(f"{path}: ")


def test_values_that_are_allowed(tmp_path):
    some = {
        "ppo": (
            {"learning_rate": "linear_1e-3", "clip_range_vf": None, "target_kl": 0.02, "gamma": 1},
            {"net_arch": {"pi": [64], "vf": []}, "squash_output": True},
        ),
        "sac": (
            {"ent_coef": "auto_0.1", "target_entropy": "auto", "gradient_steps": -1},
            {"net_arch": {"pi": [64], "qf": [32, 32]}, "n_critics": 3},
        ),
        "tqc": ({"learning_rate": "linear_1e-3"}, {"net_arch": [64]}),  # declared otherwise there
    }
    for algo, (hyperparameters, policy_kwargs) in some.items():
        values = {"hyperparameters": hyperparameters, "policy_kwargs": policy_kwargs, "algo": algo}
        assert load_config(written(tmp_path, **values)) == RunConfig(**values)


def test_whole_numbers_may_be_written_with_an_exponent():
    """Numbers are read as in a configuration file; those that are not whole, negative or infinite
    are refused.
    """
    read = [flags.positive_int(text) for text in ("1e5", "12", "2.5e1")]
    assert read == [100_000, 12, 25] and all(type(number) is int for number in read)
    assert flags.non_negative_int("0") == 0
    for text in ("0", "-1", "2.5", "1e99", "inf", "nan", "many"):
        with pytest.raises(
            argparse.ArgumentTypeError, match=f"must be a whole number .*, got '{text}'"
        ):
            flags.positive_int(text)


def test_policies_keep_labels_of_their_own(tmp_path, monkeypatch):
    """Runs of one name in different folders are told apart; the same policy given twice is
    refused.
    """
    monkeypatch.chdir(tmp_path)
    for root in ("a", "b"):
        folder = tmp_path / root / "ppo" / "JansenWalker-v0_1"
        folder.mkdir(parents=True)
        (folder / "best_model.zip").touch()
    first, second = (f"{root}/ppo/JansenWalker-v0_1" for root in ("a", "b"))
    assert named_policies.labels([first, "pid"]) == ["ppo/JansenWalker-v0_1", "pid"]
    assert named_policies.labels([first, second]) == [first, second]
    for twice in (["pid", "pid"], [first, f"./{first}"], [first, f"{first}/best_model.zip"]):
        with pytest.raises(ValueError, match="must be given only once, got it 2 times"):
            named_policies.labels(twice)


def test_what_the_command_line_says_holds_for_all_variants():
    given = ["--env", "JansenCrank-v0", "--env-kwargs", "{reset_noise_scale: 0.5}"]
    settings = train._configure(train.parse(given))
    assert settings.env_kwargs == {"reset_noise_scale": 0.5}
    assert settings.training_variants == [{}, {}, {}, {"max_episode_steps": 100}]


def test_what_all_variants_have_alike_holds_for_all_environments():
    """A batch has such arguments once; arguments that differ stay with their variant."""
    variants = [{"friction": 0.5, "slip_weight": 2.0}, {"friction": 0.6, "slip_weight": 2.0}]
    given = RunConfig(env_kwargs={"payload": 1.0}, training_variants=variants)
    common = {"payload": 1.0, "slip_weight": 2.0}
    assert config.training_envs(given) == (common, [{"friction": 0.5}, {"friction": 0.6}])
    alone = RunConfig(training_variants=variants[:1])
    assert config.training_envs(alone) == (variants[0], [{}])


def test_the_entry_for_the_zoo_is_the_shipped_configuration():
    """The entry has all settings of the shipped configuration for which the zoo has a key."""
    path = Path(__file__).parents[2] / "examples" / "rl_zoo_ppo.yml"
    entry = yaml.safe_load(path.read_text())["JansenWalkerBuilt-v0"]
    names = {"dict": dict, "nn": argparse.Namespace(Tanh="tanh")}
    network = eval(entry.pop("policy_kwargs"), names)  # as the zoo does
    assert entry.pop("normalize")
    shipped = config.new_config(env_id="JansenWalkerBuilt-v0")
    assert {**network, "normalize": True, "harmonics": 4, "half_turn": True} == {
        "activation_fn": shipped.policy_kwargs["activation"],
        **{name: v for name, v in shipped.policy_kwargs.items() if name != "activation"},
    }
    rate = shipped.hyperparameters["learning_rate"].replace("linear", "lin")
    assert entry == {
        "n_timesteps": shipped.timesteps,
        "n_envs": shipped.n_envs,
        "policy": shipped.policy,
        **shipped.hyperparameters,
        "learning_rate": rate,
    }


@pytest.mark.parametrize("script", ["agents.design", "train"])
def test_a_missing_extra_is_named_in_one_line(script):
    code = (
        "import sys, runpy; sys.modules |= dict.fromkeys(['torch', 'yaml']); "
        f"runpy.run_module({script!r}, run_name='__main__')"
    )
    done = subprocess.run([sys.executable, "-c", code, "--help"], capture_output=True, text=True)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("agents needs torch, yaml: python -m")
