"""``JansenWalkerBuilt-v0``, ``JansenWalkerRough-v0`` and ``JansenWalkerHardcore-v0``: presets.

Each is ``JansenWalker-v0`` with other defaults; any of them can be given another value. An argument
that is given, such as ``friction=0.5``, replaces what the preset's ``randomize`` draws of that
parameter. Parameters that a preset randomises are left out where they would do nothing: levels of
flat ground, noise where there is none.
"""

from __future__ import annotations

from jansen_env.tasks.walking.walker_env import JansenWalkerEnv, JansenWalkerVectorEnv
from jansen_env.world.observations import Noise
from jansen_env.world.push import Push
from jansen_env.world.settings import Values

BUILT: Values = {"robot": "built"}
ROUGH: Values = {
    **BUILT,
    "terrain": "mixed",
    "terrain_level": (0, 9),
    "speed_command": (0.1, 0.5),  # m/s
    "height_scan": (0.5, 0.9, 15),  # m behind and ahead: every 0.1 m; feet reach 0.6 m
    # The way that a robot walks counts for less than the distance that it covers.
    "slip_weight": 0.2,
    "energy_weight": 0.2,
    "effort_weight": 0.2,
    "smoothness_weight": 0.5,
    "posture_weight": 0.2,
    "load_weight": 0.2,
    "randomize": {"friction": (0.4, 1.0), "payload": (0.0, 0.5)},
}
HARDCORE: Values = {
    **ROUGH,
    "noise": Noise(),
    "push": Push(impulse=3.0),
    "randomize": {
        **ROUGH["randomize"],
        "payload_x": (-0.1, 0.1),
        "mass_scale": (0.9, 1.1),
        "foot_stiffness_scale": (0.5, 2.0),
        "foot_damping_scale": (0.5, 2.0),
        "motor_strength": (0.8, 1.2),
        "rotor_inertia_scale": (0.8, 1.2),
        "tilt": (-0.05, 0.05),
        "delay": (0.0, 0.04),
        "noise_level": (0.5, 1.5),
        "push_strength": (0.0, 1.0),
    },
}


class JansenWalkerBuiltEnv(JansenWalkerEnv):
    """Walk at a commanded speed with a machine that could be built.

    ## Description
    The task of ``JansenWalker-v0`` with the buildable robot (``docs/built_robot.md``): the paper's
    lengths, links of aluminium with the masses and inertias of their shapes, dry bearings, rubber
    feet, and a gearmotor with its rotor and torque-speed line. The paper's own robot has links of
    0.1 kg with a radius of gyration of 1 m, which no machine can have, and is much harder to drive.

    ## Action Space
    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | crank torque, as a share of ``torque_limit`` (12 N m) | -1 | 1 | 1 |

    The motor holds the torque for one control period of 0.02 s. A positive action walks towards +x.
    Actions beyond the limits are clipped.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 .. 19 | as of ``JansenWalker-v0`` | | | |

    They are of the crank, the chassis and the feet, the commanded speed, the last action, and the
    means from which the reward is computed.

    ## Rewards
    The reward of a step is a product of eight factors, each from 0 to 1, so that an episode of 500
    steps returns 500 at most. They are in ``info``, and their formulas in ``JansenWalker-v0``:

    | Factor | 1 for a robot that |
    |--------|--------------------|
    | ``reward/tracking`` | stays with a target that moves at the commanded speed |
    | ``reward/progress`` | walks at the commanded speed or up to twice as fast, in the mean over a quarter turn of the crank |
    | ``reward/slip`` | does not let its toes slide |
    | ``reward/energy`` | walks without motor power |
    | ``reward/effort`` | walks without torque |
    | ``reward/smoothness`` | does not change its action |
    | ``reward/posture`` | keeps its chassis level |
    | ``reward/load`` | presses on the ground with its weight at all times: it neither lands hard nor leaves the ground |

    A robot that stands still earns nothing, as ``reward/progress`` is 0. A fall ends the episode, and
    costs what the rest of the episode would have earned. No policy reaches 500, because walking takes
    power and torque, and because this machine cannot walk fast without leaving the ground.

    ## Starting State
    As in ``JansenWalker-v0``. Sampled at each reset:

    | Value | Range |
    |-------|-------|
    | commanded speed | 0.05 to 0.8 m/s |

    ## Arguments
    Arguments, information and the end of an episode are those of ``JansenWalker-v0``, with
    ``robot="built"``.

    ## Version History
    * v0: first release.
    """

    PRESET = BUILT


class JansenWalkerBuiltVectorEnv(JansenWalkerVectorEnv):
    """:class:`JansenWalkerBuiltEnv` for many robots at once: what ``gym.make_vec`` makes."""

    SINGLE = JansenWalkerBuiltEnv


class JansenWalkerRoughEnv(JansenWalkerEnv):
    """Walk at a commanded speed over new terrain every episode.

    ## Description
    The machine and the task of ``JansenWalkerBuilt-v0`` on ground of seven kinds: slopes, rough ground,
    waves, stairs, steps, stumps and ramps (``docs/terrain.md``), drawn at each reset at a level
    from 0, nearly flat, to 9, just beyond what the paper's robot can climb. The robot sees the ground
    ahead, carries a load that it does not know, and does not know how slippery the ground is.
    Actions and ends are those of ``JansenWalkerBuilt-v0``.

    ## Rewards
    The product of the same eight factors. What matters here is to get ahead, so the factors that judge
    how the robot walks have small exponents: ``smoothness_weight`` is 0.5, and the weights of slip,
    energy, effort, posture and load are 0.2.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 .. 19 | as of ``JansenWalker-v0`` | | | |
    | 20 .. 34 | height scan: height of the crank axis over the ground at 15 places from 0.5 m behind it to 0.9 m ahead | -Inf | Inf | m |

    ## Starting State
    As in ``JansenWalker-v0``, at x = 0; but for slopes the ground is level there, and begins to be
    otherwise 0.6 to 1 m away, on both sides. Drawn at each reset from the robot's own generator:

    | Number | Range |
    |--------|-------|
    | commanded speed | 0.1 to 0.5 m/s |
    | ``terrain_level`` | 0 to 9, and which of the seven kinds |
    | ``friction`` | 0.4 to 1.0 |
    | ``payload`` | 0 to 0.5 kg at the crank axis |

    ``reset(options={"terrain_level": 3, "friction": 0.8})`` fixes what it names for one episode.
    With ``curriculum=True`` a robot begins at level 0, goes up when it has walked more than half of
    the commanded distance, down when less than half of that, and past the top to any level
    (:class:`jansen_env.terrain.generators.Curriculum`).

    ## Information
    That of ``JansenWalker-v0``, and ``parameters``: all numbers of the episode by name
    (``env.unwrapped.parameters``: as one vector, for a critic that may know them).

    ## Arguments
    Those of ``JansenWalker-v0``, with the defaults ``robot="built"``, ``terrain="mixed"``,
    ``height_scan=(0.5, 0.9, 15)``, the weights of Rewards, and ``terrain_level``, ``speed_command`` and
    ``randomize`` as in the table of ranges. ``friction`` or ``payload`` replaces the draw of that parameter; the others are
    still drawn.

    ## Version History
    * v0: first release.
    """

    PRESET = ROUGH
    BENCHMARK = "jansen_env.tasks.walking.walker_benchmark:WORLD"


class JansenWalkerRoughVectorEnv(JansenWalkerVectorEnv):
    """:class:`JansenWalkerRoughEnv` for many robots at once: what ``gym.make_vec`` makes."""

    SINGLE = JansenWalkerRoughEnv


class JansenWalkerHardcoreEnv(JansenWalkerEnv):
    """Walk over such ground with noise, delay, pushes and machines that differ.

    ## Description
    ``JansenWalkerRough-v0`` with noisy sensors, delayed torques, pushes, a floor that is not level, and
    machines that differ from episode to episode. The torque is ``motor_strength`` times what the action
    asks for, as far as the motor can. Rewards and ends are those of ``JansenWalkerRough-v0``; they go by
    true values, not by measured ones.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 .. 34 | as of ``JansenWalkerRough-v0``, with noise | | | |

    Noise is :class:`jansen_env.world.observations.Noise`, times ``noise_level``: of each step, and a bias for
    the episode. Lag and means are as measured, mean slip is 0; command, last action and RMS torque
    are exact. ``true_observation`` in the information is without noise.

    ## Starting State
    As in ``JansenWalkerRough-v0``. Drawn at each reset:

    | Number | Range |
    |--------|-------|
    | commanded speed | 0.1 to 0.5 m/s |
    | ``terrain_level`` | 0 to 9, and which of the seven kinds |
    | ``friction`` | 0.4 to 1.0 |
    | ``payload``, ``payload_x`` | 0 to 0.5 kg, -0.1 to 0.1 m ahead of the crank axis |
    | ``mass_scale`` | 0.9 to 1.1 |
    | ``foot_stiffness_scale``, ``foot_damping_scale`` | 0.5 to 2 |
    | ``motor_strength``, ``rotor_inertia_scale`` | 0.8 to 1.2 |
    | ``tilt`` | -0.05 to 0.05 rad, by which the floor rises towards +x |
    | ``delay`` | 0 to 0.04 s |
    | ``noise_level`` | 0.5 to 1.5 |
    | ``push_strength`` | 0 to 1, of pushes of up to 3 N s, one in each 5 s |

    ## Arguments
    Those of ``JansenWalkerRough-v0`` with its defaults, and ``noise=Noise()``, ``push=Push(3.0)``,
    ``randomize`` as in the table. ``delay``, ``friction`` or ``payload`` (with its place) replaces
    the draw of that parameter; the others are still drawn.

    ## Version History
    * v0: first release.
    """

    PRESET = HARDCORE
    BENCHMARK = "jansen_env.tasks.walking.walker_benchmark:WORLD"


class JansenWalkerHardcoreVectorEnv(JansenWalkerVectorEnv):
    """:class:`JansenWalkerHardcoreEnv` for many robots at once: what ``gym.make_vec`` makes."""

    SINGLE = JansenWalkerHardcoreEnv
