"""Control steps and time steps of robots on pymunk's shapes, one robot after another.

A kernel takes the time steps of a robot. It stops whenever the contact planes of the robot must be
listed. pymunk lists the planes, and the next call of the kernel continues the step where it stopped
(:func:`jansen_env.engine.integrator.take_steps`).
"""

from __future__ import annotations

import numpy as np

from jansen_env.arrays import Array, Ints
from jansen_env.engine import episode, integrator
from jansen_env.engine.collision import WAY_OUT
from jansen_env.engine.contact_solver import STICK
from jansen_env.engine.episode import Episodes, Observing
from jansen_env.engine.records import Scratch
from jansen_env.plants.kernel_arrays import KernelArrays


class RobotsOnShapes:
    """Simulator of those robots in a batch whose ground consists of pymunk's shapes.

    Args:
        arrays: Kernel arrays of all n robots in the batch.
        scratch: Work space of the kernels, large enough for one control step.
    """

    def __init__(self, arrays: KernelArrays, scratch: Scratch) -> None:
        self._arrays = arrays
        self._scratch = scratch
        count = len(arrays.records.data)
        steps = scratch.pushes.shape[1]
        self._advance = integrator.advance.bound()
        self._begin_step = episode.begin_step.bound()
        self._finish_step = episode.finish_step.bound()
        # The kernels get the same arrays in every call, because they remember their arguments.
        self._queues = np.zeros((2, 2), np.int64)
        self._views = dict[int, tuple[Ints, Array]]()
        self._torque = np.zeros(count)  # in N m
        self._earlier = np.zeros(count)
        self._switch = np.zeros(count, np.int64)
        self._impulses = np.zeros((count, steps, 2))  # in N s
        self._no_impulses = np.zeros((0, 0, 2))

    def control_step(
        self, row: int, actions: Array, trace: Array, episodes: Episodes, observing: Observing
    ) -> None:
        """Simulate one control step of a robot; see :mod:`jansen_env.engine.episode`.

        Args:
            row: Index of the robot.
            actions: Actions of all robots, as fractions of the torque limit, shape (n, 1).
            trace: Array that receives the trace of the first robot's time steps, shape
                (steps, numbers). If it has no rows, nothing is traced.
            episodes: Parts of the robots' records that belong to the episode and the task.
            observing: Observations of the robots, and the settings that define them.
        """
        records = self._arrays.records
        settings = self._arrays.designs.world
        _, impulses = self._views_of(row)
        action = float(actions[row, 0])
        pushed = self._begin_step(row, action, impulses, records.robots, episodes)
        whole, switch = records.robots["delay"][row].tolist()
        self._torque[row] = records.torques[row, whole]
        self._earlier[row] = records.torques[row, whole + 1]
        self._switch[row] = switch
        pushes = self._impulses if pushed else self._no_impulses
        torques = self._torque, self._earlier, self._switch, pushes
        self.step(row, int(settings["steps"][0]), False, torques, trace)
        if settings["fully_compiled"][0]:
            self._arrays.look_down(row, observing.scan)
        surface = self._arrays.grounds.surface
        pressed = self._scratch.pressed
        self._finish_step(row, settings, surface, pressed, records.motions, episodes, observing)

    def step(
        self, row: int, steps: int, ahead: bool, torques: tuple[object, ...], trace: Array
    ) -> None:
        """Simulate some time steps of a robot.

        Args:
            row: Index of the robot.
            steps: Number of time steps.
            ahead: Whether to look ahead only, and to restore the state afterwards.
            torques: Arguments ``torque``, ``earlier``, ``switch`` and ``pushes`` of
                :func:`integrator.advance`.
            trace: Array that receives the trace of the first robot's time steps, shape
                (steps, numbers). If it has no rows, nothing is traced.
        """
        arrays = self._arrays
        records = arrays.records
        rows, _ = self._views_of(row)
        status = records.status[row]
        status["waits"] = False
        while True:
            self._queues[0] = 0, 1
            self._advance(
                0,
                self._queues,
                1,
                rows,
                steps,
                ahead,
                *torques,
                trace,
                self._scratch,
                arrays.designs,
                records.motions,
            )
            if not status["waits"]:
                break
            self._list_planes(row)
        if not records.diverged[row]:
            sides = arrays.pad_centres(row)[arrays.sides]
            crossing = arrays.grounds.shapes_of(row).count_crossing(sides)
            records.accumulators["links_in_ground"][row] = crossing

    def _views_of(self, row: int) -> tuple[Ints, Array]:
        """Return arrays that kernels take for one robot.

        Returns:
            The index of the robot, shape (1,), and the impulses on its chassis in each time step,
            in N s, shape (steps, 2).
        """
        if row not in self._views:
            self._views[row] = np.array([row]), self._impulses[row]
        return self._views[row]

    def _list_planes(self, row: int) -> None:
        """List the contact planes of a robot whose step waits for them."""
        status = self._arrays.records.status[row]
        planes = self._scratch.planes
        near = float(status["pad_radius"] + status["margin"])
        centres = self._arrays.pad_centres(row)
        found = self._arrays.grounds.shapes_of(row).find(centres, near)
        if len(found) > len(planes):
            found = sorted(found, key=lambda plane: plane.distance)[: len(planes)]
        for k, plane in enumerate(found):
            planes[k] = (*plane, -1, 0.0, 0.0, STICK, 0.0, 0.0)
        status["first_plane"] = 0
        status["end_plane"] = len(found)
        status["too_deep"] = any(plane.distance < -WAY_OUT for plane in found)
