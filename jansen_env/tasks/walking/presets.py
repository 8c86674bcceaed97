"""``JansenWalkerBuilt-v0``, ``JansenWalkerRough-v0`` and ``JansenWalkerHardcore-v0``: presets.

Each preset is ``JansenWalker-v0`` with other default arguments, all of which you can override. An
argument that you specify, such as ``friction=0.5``, replaces the values that the preset's
``randomize`` samples for this parameter. A preset does not randomise parameters that would have no
effect, such as the level of flat terrain, or the noise level without noise.
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
    "height_scan": (0.5, 0.9, 15),  # 0.5 m behind to 0.9 m ahead, every 0.1 m; feet reach 0.6 m
    # How a robot walks counts less than the distance that it covers.
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
    """Walk at a commanded speed with a robot that could be built.

    ## Description
    The task is that of ``JansenWalker-v0`` with the buildable robot (``docs/built_robot.md``). It
    has the link lengths of the paper, aluminium links whose masses and inertias follow from their
    shapes, dry bearings, rubber feet, and a gearmotor with a rotor inertia and a torque-speed
    curve. The paper's own robot has links of 0.1 kg with a radius of gyration of 1 m, which is
    physically impossible, and is much harder to control.

    ## Action Space
    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | crank torque, as a fraction of ``torque_limit`` (12 N m) | -1 | 1 | 1 |

    The motor holds the torque for one control period of 0.02 s. A positive action walks towards +x.
    Actions beyond the limits are clipped.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 .. 19 | as in ``JansenWalker-v0`` | | | |

    The observation describes the crank, the chassis and the feet. It also contains the commanded
    speed, the last action, and the means from which the reward is computed.

    ## Rewards
    The reward of a step is a product of eight factors, each from 0 to 1, so an episode of 500 steps
    has a return of at most 500. ``info`` contains the factors, and ``JansenWalker-v0`` documents
    their formulas:

    | Factor | Is 1 for a robot that |
    |--------|--------------------|
    | ``reward/tracking`` | stays with a target that moves at the commanded speed |
    | ``reward/progress`` | walks at the commanded speed or up to twice as fast, on average over a quarter turn of the crank |
    | ``reward/slip`` | does not let its toes slide |
    | ``reward/energy`` | walks without motor power |
    | ``reward/effort`` | walks without torque |
    | ``reward/smoothness`` | does not change its action |
    | ``reward/posture`` | keeps its chassis level |
    | ``reward/load`` | presses on the ground with its weight at all times: it neither lands hard nor leaves the ground |

    A robot that stands still earns nothing, because ``reward/progress`` is 0. A fall ends the
    episode, and costs what the rest of the episode would have earned. No policy achieves 500, because
    walking takes power and torque, and because this robot cannot walk fast without leaving the ground.

    ## Starting State
    The robot starts as in ``JansenWalker-v0``. This value is sampled at each reset:

    | Value | Range |
    |-------|-------|
    | commanded speed | 0.05 to 0.8 m/s |

    ## Arguments
    The arguments, the information and the end of an episode are those of ``JansenWalker-v0``, with
    ``robot="built"`` by default.

    ## Version History
    * v0: first release.
    """

    PRESET = BUILT


class JansenWalkerBuiltVectorEnv(JansenWalkerVectorEnv):
    """Vector environment of many :class:`JansenWalkerBuiltEnv` robots, made by ``gym.make_vec``."""

    SINGLE = JansenWalkerBuiltEnv


class JansenWalkerRoughEnv(JansenWalkerEnv):
    """Walk at a commanded speed over new terrain in every episode.

    ## Description
    The robot and the task are those of ``JansenWalkerBuilt-v0``, on terrain of seven kinds: slopes,
    rough ground, waves, stairs, steps, stumps and ramps (``docs/terrain.md``). The terrain is
    generated at each reset, at a level from 0 (nearly flat) to 9 (just beyond what the paper's robot
    can climb). The robot observes the terrain ahead, but it observes neither the payload that it
    carries nor the friction of the ground. The actions and the end of an episode are those of
    ``JansenWalkerBuilt-v0``.

    ## Rewards
    The reward is the product of the same eight factors. Here it matters most to make progress, so
    the factors that judge how the robot walks have small exponents: ``smoothness_weight`` is 0.5, and
    the weights of slip, energy, effort, posture and load are 0.2.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 .. 19 | as in ``JansenWalker-v0`` | | | |
    | 20 .. 34 | height scan: height of the crank axis over the ground at 15 positions from 0.5 m behind it to 0.9 m ahead | -Inf | Inf | m |

    ## Starting State
    The robot starts as in ``JansenWalker-v0``, at x = 0. The ground is level there, except on slopes,
    and stops being level 0.6 to 1 m away, on both sides. These values are sampled at each reset from
    the robot's own random number generator:

    | Value | Range |
    |--------|-------|
    | commanded speed | 0.1 to 0.5 m/s |
    | ``terrain_level`` | 0 to 9; the kind of terrain is one of the seven |
    | ``friction`` | 0.4 to 1.0 |
    | ``payload`` | 0 to 0.5 kg at the crank axis |

    ``reset(options={"terrain_level": 3, "friction": 0.8})`` sets the named values for one episode.
    With ``curriculum=True``, a robot begins at level 0. The level increases after an episode in which
    the robot walked more than half of the commanded distance, and decreases if it walked less than a
    quarter. A robot that exceeds the highest level gets a random level
    (:class:`jansen_env.terrain.generators.Curriculum`).

    ## Information
    The information is that of ``JansenWalker-v0``. It includes ``parameters``, all parameters of the
    episode by name. (``env.unwrapped.parameters`` is the same as a vector, for a privileged critic.)

    ## Arguments
    The arguments are those of ``JansenWalker-v0``, with the defaults ``robot="built"``,
    ``terrain="mixed"``, ``height_scan=(0.5, 0.9, 15)``, the weights in Rewards, and
    ``terrain_level``, ``speed_command`` and ``randomize`` as in the table of ranges. If you specify
    ``friction`` or ``payload``, this parameter is not sampled; the others still are.

    ## Version History
    * v0: first release.
    """

    PRESET = ROUGH
    BENCHMARK = "jansen_env.tasks.walking.walker_benchmark:WORLD"


class JansenWalkerRoughVectorEnv(JansenWalkerVectorEnv):
    """Vector environment of many :class:`JansenWalkerRoughEnv` robots, made by ``gym.make_vec``."""

    SINGLE = JansenWalkerRoughEnv


class JansenWalkerHardcoreEnv(JansenWalkerEnv):
    """Walk over generated terrain with noise, delay, pushes and varying robots.

    ## Description
    This is ``JansenWalkerRough-v0`` with noisy sensors, delayed torques, pushes, a floor that is not
    level, and robots that differ from episode to episode. The torque is ``motor_strength`` times the
    commanded torque, within the limits of the motor. The rewards and the end of an episode are those
    of ``JansenWalkerRough-v0``. They depend on true values, not on measured values.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 .. 34 | as in ``JansenWalkerRough-v0``, with noise | | | |

    The noise is :class:`jansen_env.world.observations.Noise`, multiplied by ``noise_level``. It
    consists of noise in each step and a bias for the episode. The lag and the means are computed from
    measurements, and the mean slip is 0. The command, the last action and the RMS torque are exact.
    ``info["true_observation"]`` is the observation without noise.

    ## Starting State
    The robot starts as in ``JansenWalkerRough-v0``. These values are sampled at each reset:

    | Value | Range |
    |--------|-------|
    | commanded speed | 0.1 to 0.5 m/s |
    | ``terrain_level`` | 0 to 9; the kind of terrain is one of the seven |
    | ``friction`` | 0.4 to 1.0 |
    | ``payload``, ``payload_x`` | 0 to 0.5 kg, -0.1 to 0.1 m ahead of the crank axis |
    | ``mass_scale`` | 0.9 to 1.1 |
    | ``foot_stiffness_scale``, ``foot_damping_scale`` | 0.5 to 2 |
    | ``motor_strength``, ``rotor_inertia_scale`` | 0.8 to 1.2 |
    | ``tilt`` | -0.05 to 0.05 rad; the floor rises towards +x if it is positive |
    | ``delay`` | 0 to 0.04 s |
    | ``noise_level`` | 0.5 to 1.5 |
    | ``push_strength`` | 0 to 1, the factor of pushes of up to 3 N s, one in every 5 s |

    ## Arguments
    The arguments are those of ``JansenWalkerRough-v0`` with its defaults, and ``noise=Noise()``,
    ``push=Push(3.0)``, and ``randomize`` as in the table. If you specify ``delay``, ``friction`` or
    ``payload`` (including its position), this parameter is not sampled; the others still are.

    ## Version History
    * v0: first release.
    """

    PRESET = HARDCORE
    BENCHMARK = "jansen_env.tasks.walking.walker_benchmark:WORLD"


class JansenWalkerHardcoreVectorEnv(JansenWalkerVectorEnv):
    """Vector environment of :class:`JansenWalkerHardcoreEnv` robots, made by ``gym.make_vec``."""

    SINGLE = JansenWalkerHardcoreEnv
