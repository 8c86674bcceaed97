from __future__ import annotations

import numpy as np

VARIATION = np.dtype(
    [
        (n, "f8")
        for n in (
            "friction",
            "restitution",
            "payload",
            "payload_x",
            "payload_y",
            "mass_scale",
            "inertia_scale",
            "damping_scale",
            "foot_stiffness_scale",
            "foot_damping_scale",
            "motor_strength",
            "rotor_inertia_scale",
            "tilt",
        )
    ]
)


def nominal(robot, terrain):
    r = np.ones((), VARIATION)
    r["friction"], r["restitution"] = terrain.friction, terrain.restitution
    r["payload"] = robot.payload.mass
    r["payload_x"], r["payload_y"] = robot.payload.position
    r["tilt"] = 0
    return r


def without_effect(robot):
    return {}
