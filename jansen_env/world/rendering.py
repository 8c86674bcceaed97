"""Pictures of a walking robot: a side view that follows it, with contact forces and gauges.

Everything is painted on a canvas that is three times as large as the picture. The canvas is then
scaled down, which smooths edges and text. Pygame is imported when it is first needed. In this
module, "units" are pixels of the picture.

Robots, states and payloads may come from untrusted files, and pygame also needs time and memory for
shapes outside its canvas. Therefore every shape is clipped to the canvas before it is painted, and
the numbers of marks, points and characters are limited. The time for a picture does not depend on
its content.
"""

import itertools
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.arrays import Array
from jansen_env.engine.contact_frames import AIR, GRIP, SLIP
from jansen_env.engine.mathematics import directions
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import joint_positions, world_joints
from jansen_env.terrain import Piece, heights_of
from jansen_env.world.drawn_springs import coil, drawn_springs, spiral

Picture = NDArray[np.uint8]
Point = Array | tuple[float, float]
Corners = Array | Sequence[Point]  # shape (n, 2)
Color = tuple[int, int, int]

ARROW_PER_WEIGHT = 0.25  # length of the arrow of a force equal to the robot's weight, in m
ARROW_PER_REACH = 0.1, 0.35  # limits of this length, as fractions of the robot's reach
LONGEST_ARROW = 2.4  # longest arrow divided by this length, so that impacts stay in the picture
COIL_WIDTH = 11.0  # width of a linear spring, in units
SPIRAL_RADIUS = 11.0  # radius of a torsion spring, in units
PAYLOAD_SIDE = 0.085  # half side of the box of a payload of 1 kg, in m
PAYLOAD_SIDES = 0.06, 0.17  # limits of the half side of the box of a payload, in m
LARGEST_PAYLOAD = 0.25  # largest half side of the box of a payload, as a fraction of the reach
PICTURE_HEIGHT = 1.66  # least height of a picture, divided by the reach
PICTURE_WIDTH = 2.3  # least width of a picture, divided by the reach
AXIS_HEIGHT = 0.85  # height of the crank axis in a picture without terrain, divided by the reach
DEPTH_BELOW = 0.24  # height of the picture below the ground, divided by the reach
NEARBY = 0.7  # distance to each side at which terrain counts as nearby, divided by the reach
NEARBY_POINTS = 15  # number of points of which the mean height of nearby terrain is computed
TICK_SPACING = 0.5  # distance between marks on the ground, in m; wider if there would be too many
MOST_MARKS = 40  # largest number of marks
LOAD_RANGE = 5.0  # load at the end of the load gauge, as a multiple of the weight
REACHES = 1e-6, 1e6  # limits of a robot's reach, in m; a reach beyond them is clipped
FARTHEST = 1e12  # largest coordinate of a pose (m) and of a shape's corner (canvas pixels)
MOST_DIGITS = 1e6  # numbers of this magnitude or larger are written with an exponent
SIZE = (960, 540)  # width and height of the picture, in pixels
UNIT = 3  # canvas pixels per picture pixel
WIDTH, HEIGHT = UNIT * SIZE[0], UNIT * SIZE[1]  # size of the canvas, in canvas pixels
AROUND = 60 * UNIT  # margin around the canvas within which shapes are kept, in canvas pixels
MANY = 16  # number of points above which NumPy is faster than a loop
ROUND = 4096  # largest radius of a disc that pygame paints, in canvas pixels

SKY = (241, 246, 251)
GRID = (222, 231, 240)
GROUND = (234, 223, 202)
SURFACE = (150, 128, 94)
GROUND_TEXT = (104, 86, 58)
INK = (38, 50, 66)
MUTED = (100, 112, 128)
TRACK = (220, 227, 235)
WHITE = (255, 255, 255)
LINK = (58, 124, 190)
CRANK = (240, 140, 16)
FORCE = (124, 58, 190)
SPRING = (146, 84, 20)
GREEN = (0, 140, 122)
RED = (220, 38, 38)
LEGEND = {"gripping toe": GRIP, "slipping toe": SLIP, "lifted toe": AIR, "contact force": None}
CIRCLE = np.array([(math.cos(a), math.sin(a)) for a in np.linspace(0.0, 2.0 * math.pi, 32)])


@dataclass(frozen=True, eq=False)
class Frame:
    """Content of one picture, with toes in the order of ``robot.toes``.

    Attributes:
        q: Position x, y of the crank axis (m), chassis pitch theta and crank angle psi (rad), shape
            (4,).
        contact: State of each toe, ``AIR``, ``GRIP`` or ``SLIP``, shape (toes,).
        contact_point: Point at which each toe touches the ground, in the world frame, in m, shape
            (toes, 2).
        contact_force: Force of the ground on each toe, in the world frame, in N, shape (toes, 2).
        weight: Weight of robot and payload, in N.
        command: Commanded speed, in the unit of the renderer. None for no command.
        speed: Speed, in the unit of the renderer.
        torque: Crank torque, in N m.
        torque_limit: Largest magnitude of the crank torque, in N m.
        time: Time, in s.
        goal: Position x of the goal, in m. None for no goal.
        load: Load that the ground carries, as a multiple of the weight. None without ground.
    """

    q: Array
    contact: NDArray[np.int_]
    contact_point: Array
    contact_force: Array
    weight: float
    command: float | None
    speed: float
    torque: float
    torque_limit: float
    time: float
    goal: float | None = None
    load: float | None = None


class Renderer:
    """A painter of frames, off-screen or in a window.

    Args:
        robot: Robot to draw.
        terrain_points: Points on the surface of the terrain from left to right, in m, shape (n, 2).
            None for a robot whose chassis is held in the air.
        mode: ``"rgb_array"`` to return pictures, which needs no display, or ``"human"`` to show a
            window.
        fps: Pictures per second in the window.
        speed_range: Speed at each end of the speed gauge.
        speed_unit: Unit of the speed gauge.
        shapes: Shapes of a terrain that is not a height line. ``terrain_points`` then describes the
            upper side of the shapes.
    """

    def __init__(
        self,
        robot: Robot,
        terrain_points: Array | None,
        mode: str,
        fps: float,
        speed_range: float = 1.0,
        speed_unit: str = "m/s",
        shapes: Sequence[Piece] = (),
    ) -> None:
        self.mode = mode
        self.fps = fps
        self.speed_range = speed_range
        self.speed_unit = speed_unit
        self.show(robot, terrain_points, shapes)
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        import pygame

        self._pg: Any = pygame
        self._canvas: Any = None
        self._screen: Any = None
        self.dismissed = False  # whether the user closed the window, or there is no display
        self._fonts: dict[int, Any] = {}

    def show(
        self,
        robot: Robot,
        terrain_points: Array | None,
        shapes: Sequence[Piece] = (),
        **_: object,
    ) -> None:
        """Use another robot and another terrain in the following pictures.

        Args:
            robot: Robot to draw.
            terrain_points: See the class.
            shapes: See the class.
        """
        self.robot = robot
        self._terrain = terrain_points
        self._shapes = shapes
        self._reach = reach = min(max(reach_of(robot), REACHES[0]), REACHES[1])
        least, most = ARROW_PER_REACH
        self._arrow_per_weight = min(max(ARROW_PER_WEIGHT, least * reach), most * reach)
        # canvas pixels per m
        self._scale = min(HEIGHT / (PICTURE_HEIGHT * reach), WIDTH / (PICTURE_WIDTH * reach))
        self._depth = depths_of(robot)
        self._springs = drawn_springs(robot)

    def draw(self, frame: Frame) -> Picture | None:
        """Paint a frame.

        In the mode ``"human"``, show the picture in the window and wait so long that the rate is
        ``fps``. A window that the user has closed is not opened again. If there is no display, the
        method issues a warning and opens no window.

        Args:
            frame: Content of the picture.

        Returns:
            A new array of type uint8, shape (height, width, 3), or None in the mode ``"human"``.
        """
        pg = self._pg
        human = self.mode == "human"
        # Other code in the process may quit pygame, which closes the window.
        if human and not self.dismissed and not (self._screen and pg.display.get_init()):
            self._open_window()
        if human and self._screen and any(event.type == pg.QUIT for event in pg.event.get()):
            self.close()
            self.dismissed = True
        if self.dismissed:
            return None
        if self._canvas is None:
            self._canvas = pg.Surface((WIDTH, HEIGHT), 0, 32)
        self._paint(frame)
        picture = pg.transform.smoothscale(self._canvas, SIZE)
        if human:
            self._screen.blit(picture, (0, 0))
            pg.display.flip()
            self._clock.tick(self.fps)
            return None
        # From a bytearray, unlike from bytes, NumPy makes an array that can be written to.
        data = bytearray(pg.image.tobytes(picture, "RGB"))
        return np.frombuffer(data, np.uint8).reshape(*SIZE[::-1], 3)

    def close(self) -> None:
        """Close the window and free the canvas. Further calls have no effect."""
        if self._screen is not None:
            self._pg.display.quit()
        self._screen = self._canvas = None

    def _open_window(self) -> None:
        """Open the window, or issue a warning if there is no display."""
        pg = self._pg
        try:
            pg.display.init()
            # Without a display, SDL silently opens an invisible window, unless the user has chosen
            # a video driver.
            if pg.display.get_driver() == "offscreen" and "SDL_VIDEODRIVER" not in os.environ:
                pg.display.quit()
                raise pg.error("no display found")
            self._screen = pg.display.set_mode(SIZE)
        except pg.error as error:  # Gymnasium's checker requires that the environment continues
            warn(
                f"the window cannot be opened: {error}; the mode 'rgb_array' needs no display",
                stacklevel=2,
            )
            self.dismissed = True
            return
        pg.display.set_caption("Jansen linkage")
        self._clock = pg.time.Clock()

    def _paint(self, frame: Frame) -> None:
        """Paint a frame on the canvas."""
        q = np.clip(np.asarray(frame.q, dtype=float), -FARTHEST, FARTHEST)
        level = q[1] - AXIS_HEIGHT * self._reach
        if self._terrain is not None:
            # Following the mean height nearby keeps the picture steady on rough terrain.
            ways = self._reach * np.linspace(-NEARBY, NEARBY, NEARBY_POINTS)
            near = self._surface(q[0] + ways)
            level = min(max(float(near[:, 1].mean()), q[1] - self._reach), q[1])
        bottom = level - DEPTH_BELOW * self._reach
        self._corner = np.array([q[0] - 0.5 * WIDTH / self._scale, bottom + HEIGHT / self._scale])
        self._canvas.fill(SKY)
        if self._terrain is not None:
            self._paint_ground(self._terrain)
            if frame.goal is not None:
                self._paint_flag(frame.goal)

        legs = self._pixels(world_joints(self.robot, q))
        springs = self._spring_lines(legs, q)
        order = sorted(range(len(legs)), key=lambda leg: -self._depth[leg])
        far = [leg for leg in order if self._depth[leg] > 0.0]
        for leg in far:
            self._paint_leg(legs[leg], self._depth[leg])
            self._paint_springs(springs[leg], self._depth[leg])
        self._paint_chassis(legs, q)
        for leg in order[len(far) :]:
            self._paint_leg(legs[leg], 0.0)
            self._paint_springs(springs[leg], 0.0)
        pad = max(self.robot.pad_radius * self._scale / UNIT, 4.5)
        forces = frame.contact_force / frame.weight
        toes = sorted(enumerate(self.robot.toes), key=lambda toe: -self._depth[toe[1][0]])
        for k, (leg, joint) in toes:
            self._arrow(self._pixels(frame.contact_point[k]), forces[k] * [1.0, -1.0])
            self._toe(legs[leg, joint], pad, frame.contact[k])
        self._paint_gauges(frame)
        if self._terrain is not None:
            self._paint_legend()

    def _paint_ground(self, terrain: Array) -> None:
        """Paint the ground below its surface points, with marks that show positions."""
        u = UNIT
        left = self._corner[0]
        right = left + WIDTH / self._scale
        inside = terrain[(terrain[:, 0] > left) & (terrain[:, 0] < right)]
        if len(inside) > WIDTH:  # more points than pixels
            inside = self._surface(np.linspace(left, right, WIDTH)[1:-1])
        ends = self._surface(np.array([left, right]))
        surface = self._pixels(np.concatenate([ends[:1], inside, ends[1:]]))
        spacing = _tick_spacing(right - left)
        marks = math.floor(left / spacing) + np.arange(math.ceil((right - left) / spacing) + 2.0)
        tops = self._pixels(self._surface(marks * spacing))
        for x, _ in tops:
            self._line((x, 0.0), (x, HEIGHT), 1.0, GRID)
        below = [(WIDTH, max(HEIGHT, surface[-1, 1])), (0, max(HEIGHT, surface[0, 1]))]
        if self._shapes:
            self._paint_shapes()
        else:
            self._polygon(np.concatenate([surface, below]), GROUND)
        for mark, (x, y) in zip(marks, tops, strict=True):
            self._line((x, y), (x, y + (9 if mark % 2 else 14) * u), 2.0, SURFACE)
            if y < HEIGHT - 72 * u:
                label = _mark_label(mark, spacing)
                self._text(label, x, y + 24 * u, 20 if mark % 2 else 24, GROUND_TEXT, 0.5)
        if not self._shapes:
            self._polyline(surface, SURFACE, 3 * u)

    def _paint_shapes(self) -> None:
        """Paint convex shapes as one: all outlines, then all insides, which cover the seams."""
        for color, width in ((SURFACE, 1.5), (GROUND, 0.0)):
            for piece in self._shapes:
                points = self._pixels(np.array(piece.points))
                radius = piece.radius * self._scale / UNIT + width
                for start, end in zip(points, np.roll(points, -1, axis=0), strict=True):
                    self._line(start, end, 2.0 * radius, color)
                    self._disc(start, radius, color)
                self._polygon(points, color)

    def _paint_flag(self, x: float) -> None:
        """Paint a flag at a position x in m."""
        foot = self._pixels(self._surface(np.array([x])))[0]
        height = 0.6 * self._reach * self._scale
        side = 24.0 * UNIT
        flag = np.array([[0.0, height], [0.0, height - side], [1.5 * side, height - 0.5 * side]])
        points = foot + flag * np.array([1.0, -1.0])
        self._line(foot, points[0], 4.0, INK)
        self._polygon(points, CRANK)

    def _paint_leg(self, joints: Array, depth: float) -> None:
        """Paint a leg without its frame.

        Args:
            joints: Positions of the joints on the canvas, shape (joints, 2).
            depth: Depth from 0, the nearest, to 1, the farthest, by which the colors fade.
        """
        fade = 0.58 * math.sqrt(depth)
        ink = _mix(INK, SKY, fade)
        fill = _mix(LINK, SKY, fade)
        crank = _mix(CRANK, SKY, fade)
        _, cranks, *others = self.robot.linkage.edges  # the frame is the chassis
        for edges in others:
            if len(edges) > 2:
                self._blend(joints[[start for start, _ in edges]], fill, 60 if depth else 95)
        for start, end in (edge for edges in others for edge in edges):
            self._line(joints[start], joints[end], 5.0 - depth, ink)
        for start, end in cranks:
            self._line(joints[start], joints[end], 8.0 - 2.0 * depth, crank)
        ends = [joint for _, joint in self.robot.toes]
        for joint in np.delete(joints, ends, axis=0):
            self._disc(joint, 4.2 - 0.6 * depth, ink)
            self._disc(joint, 2.3 - 0.4 * depth, WHITE)

    def _spring_lines(self, legs: Array, q: Array) -> list[list[Array]]:
        """Return the lines of the springs of each leg on the canvas, each of shape (points, 2).

        Args:
            legs: Positions of the joints of all legs on the canvas, shape (legs, joints, 2).
            q: Position x, y of the crank axis (m), chassis pitch theta and crank angle psi (rad).
        """
        lines: list[list[Array]] = [[] for _ in legs]
        turn = np.array([directions(q[2]), directions(q[2] + 0.5 * math.pi)])
        for leg, joints, anchor in self._springs:
            places = [_bounded(legs[leg, [joint]])[0] for joint in joints]
            if anchor is not None:
                places += list(_bounded(self._pixels([anchor @ turn + q[:2]])))
            if len(places) == 3:
                pin, first, second = places
                line = spiral(pin, first, second, SPIRAL_RADIUS * UNIT)
            else:
                start, end = places
                line = coil(start, end, COIL_WIDTH * UNIT)
            lines[leg].append(line)
        return lines

    def _paint_springs(self, lines: list[Array], depth: float) -> None:
        """Paint the springs of a leg, with a disc at each end.

        Args:
            lines: Points of each spring on the canvas.
            depth: Depth from 0, the nearest, to 1, the farthest, by which the colors fade.
        """
        color = _mix(SPRING, SKY, 0.58 * math.sqrt(depth))
        for line in lines:
            for start, end in itertools.pairwise(line):
                self._line(start, end, 2.2, color)
            self._disc(line[0], 2.6, color)
            self._disc(line[-1], 2.6, color)

    def _paint_chassis(self, legs: Array, q: Array) -> None:
        """Paint the frames of all legs, which form the chassis, and the payload."""
        load = self.robot.payload
        if load.mass > 0.0:
            turn = np.array([directions(q[2]), directions(q[2] + 0.5 * math.pi)])
            least, most = PAYLOAD_SIDES
            half = min(max(PAYLOAD_SIDE * load.mass ** (1.0 / 3.0), least), most)
            half = min(half, LARGEST_PAYLOAD * self._reach)
            box = half * np.array([[-1.0, -0.6], [1.0, -0.6], [1.0, 0.6], [-1.0, 0.6]])
            corners = self._pixels((box + load.position) @ turn + q[:2])
            center = corners.mean(axis=0)
            x, y = center
            self._line(legs[0][self.robot.linkage.axis], center, 6.0, MUTED)
            self._polygon(corners, _mix(MUTED, WHITE, 0.6))
            self._polygon(corners, MUTED, round(2.5 * UNIT))
            self._text(f"{load.mass:.3g} kg", x, y, 15, INK, 0.5)
        for width, color in ((9.0, INK), (5.0, _mix(INK, LINK, 0.55))):
            for joints in legs:
                for start, end in self.robot.linkage.edges[0]:
                    self._line(joints[start], joints[end], width, color)

    def _paint_gauges(self, frame: Frame) -> None:
        """Paint the card with the time and the gauges of speed, torque and load."""
        u = UNIT
        self._card(14, 236, 180 if frame.load is None else 228)
        self._text(f"{_number(frame.time)} s", 28 * u, 38 * u, 30, INK, 0.0)
        self._text(
            f"{_number(frame.speed, '+.2f')} {self.speed_unit}", 236 * u, 72 * u, 23, INK, 1.0
        )
        self._gauge("speed", 72, frame.speed, self.speed_range, LINK, frame.command)
        wanted, end = (frame.command, "") if frame.goal is None else (frame.goal, " m")
        if wanted is not None:
            label = f"{'goal' if end else 'command'} {_number(wanted, '+.2f')}{end}"
            self._text(label, 236 * u, 112 * u, 23, _mix(CRANK, INK, 0.35), 1.0)
        self._text(f"{_number(frame.torque, '+.1f')} N m", 236 * u, 150 * u, 23, INK, 1.0)
        self._gauge("torque", 150, frame.torque, frame.torque_limit, FORCE, None)
        if frame.load is not None:
            self._text(f"{_number(frame.load, '.1f')} weights", 236 * u, 198 * u, 23, INK, 1.0)
            self._gauge("load", 198, frame.load, LOAD_RANGE, RED, 1.0)

    def _gauge(
        self, name: str, y: float, value: float, limit: float, color: Color, mark: float | None
    ) -> None:
        """Paint a bar from zero, in the middle, to a value.

        Args:
            name: Name of the gauge.
            y: Vertical position, in units.
            value: The value.
            limit: Magnitude of the values at both ends of the gauge.
            color: Color of the bar.
            mark: Value that a tick marks. None for no tick.
        """
        u = UNIT
        middle = 132.0
        half = 104.0
        self._text(name, 28 * u, y * u, 23, MUTED, 0.0)

        def place(shown: float) -> float:
            """Return the horizontal position of a value, in units."""
            return middle + half * min(max(shown / max(limit, 1e-9), -1.0), 1.0)

        end = place(value)
        bars = ((middle - half, 2 * half, TRACK), (min(middle, end), abs(end - middle), color))
        for left, width, paint in bars:
            box = [round(edge * u) for edge in (left, y + 12, width, 8)]
            self._pg.draw.rect(self._canvas, paint, box, border_radius=round(2.5 * u))
        self._line((middle * u, (y + 10) * u), (middle * u, (y + 22) * u), 1.5, MUTED)
        if mark is not None:
            tick = place(mark)
            self._line((tick * u, (y + 9) * u), (tick * u, (y + 23) * u), 3.0, CRANK)

    def _paint_legend(self) -> None:
        """Paint the card that explains the toes and arrows."""
        u = UNIT
        left = SIZE[0] - 194
        self._card(left, 180, 136)
        for line, (label, contact) in enumerate(LEGEND.items()):
            x, y = (left + 20) * u, (35 + 31 * line) * u
            if contact is not None:
                self._toe(np.array([x, y]), 4.5, contact)
            else:
                length = 22 * u / (self._arrow_per_weight * self._scale)
                self._arrow(np.array([x - 9 * u, y]), np.array([length, 0.0]))
            self._text(label, (left + 42) * u, y, 23, INK, 0.0)

    # The following primitives expect positions in canvas pixels, but widths, radii and cards in
    # units.

    def _surface(self, x: Array) -> Array:
        """Return the points of the surface at positions ``x`` in m, shape (n,); shape (n, 2)."""
        assert self._terrain is not None
        return np.stack([x, heights_of(self._terrain, x)], axis=-1)

    def _pixels(self, points: ArrayLike) -> Array:
        """Convert positions in the world, in m, to positions on the canvas, shape (..., 2)."""
        moved: Array = (np.asarray(points) - self._corner) * (self._scale, -self._scale)
        return moved

    def _polygon(self, points: Corners, color: Color, width: int = 0) -> None:
        """Paint a filled polygon, or its outline if it has a width in canvas pixels."""
        seen = points if _is_seen(points) else clip_polygon(points, *CLIP)
        if len(seen) > 2:
            self._pg.draw.polygon(self._canvas, color, seen, width)

    def _polyline(self, points: Array, color: Color, width: int) -> None:
        """Paint lines from each point to the next, with a width in canvas pixels."""
        if _is_seen(points):
            self._pg.draw.lines(self._canvas, color, False, points, width)
            return
        for start, end in clip_lines(points, *CLIP):
            self._pg.draw.line(self._canvas, color, start, end, width)

    def _line(self, start: Point, end: Point, width: float, color: Color) -> None:
        """Paint a bar, whose ends are round if it is wide enough for this to be visible."""
        ends = (start, end)
        (x, y), (u, v) = ends if _is_seen(ends) else _bounded(ends)
        share = 0.5 * width * UNIT / max(math.hypot(u - x, v - y), 1e-9)
        dx, dy = share * (v - y), share * (u - x)
        self._polygon(
            ((x - dx, y + dy), (u - dx, v + dy), (u + dx, v - dy), (x + dx, y - dy)), color
        )
        if width > 2.0:
            self._disc((x, y), 0.5 * width, color)
            self._disc((u, v), 0.5 * width, color)

    def _disc(self, center: Point, radius: float, color: Color) -> None:
        """Paint a disc."""
        size = radius * UNIT
        if size > ROUND:
            self._polygon(circle(np.asarray(center), size), color)
        elif _is_seen((center,), size):
            self._pg.draw.circle(self._canvas, color, center, size)

    def _toe(self, center: Array, radius: float, contact: int) -> None:
        """Paint a toe pad, hollow if it is lifted, or solid with a halo if it has contact."""
        if contact == AIR:
            self._disc(center, radius, INK)
            self._disc(center, radius - 1.8, WHITE)
            return
        color = RED if contact == SLIP else GREEN
        if (halo := 2.1 * radius * UNIT) < HEIGHT:  # a larger halo would fill the background
            self._blend(circle(center, halo), color, 85)
        self._disc(center, radius + 1.0, WHITE)
        self._disc(center, radius, color)

    def _card(self, x: int, width: int, height: int) -> None:
        """Paint a translucent panel at the top of the picture."""
        u = UNIT
        card = self._pg.Surface((width * u, height * u), self._pg.SRCALPHA)
        for color, border in (((*WHITE, 215), 0), (TRACK, u)):
            self._pg.draw.rect(card, color, card.get_rect(), border, border_radius=10 * u)
        self._canvas.blit(card, (x * u, 14 * u))

    def _blend(self, points: Array, color: Color, alpha: int) -> None:
        """Paint a translucent polygon, because polygons of pygame are opaque."""
        seen: Array = points if _is_seen(points) else clip_polygon(points, *CLIP)
        if len(seen) < 3:
            return
        low = np.floor(seen.min(axis=0)) - 1.0
        patch = self._pg.Surface(np.ceil(seen.max(axis=0) - low) + 2.0, self._pg.SRCALPHA)
        self._pg.draw.polygon(patch, (*color, alpha), seen - low)
        self._canvas.blit(patch, low)

    def _arrow(self, start: Array, force: Array) -> None:
        """Paint the arrow of a force, unless it is too short to be visible.

        Args:
            start: Start of the arrow, in canvas pixels.
            force: Force as a multiple of the robot's weight, with y downwards, shape (2,).
        """
        size = float(np.hypot(*force))
        length = min(size, LONGEST_ARROW) * self._arrow_per_weight * self._scale
        if length < 4.0 * UNIT:
            return
        along = force / size
        head = min(12.0 * UNIT, 0.6 * length)
        neck = start + (length - head) * along
        side = np.array([-force[1], force[0]]) / size
        self._line(start, neck, 3.4, FORCE)
        across = 0.45 * head * side
        tip = neck + head * along
        self._polygon([tip, neck + across, neck - across], FORCE)

    def _text(self, text: str, x: float, y: float, size: int, color: Color, align: float) -> None:
        """Paint a line of text that is vertically centred at ``y``.

        The line starts at ``x`` if ``align`` is 0, is centred at ``x`` if it is 0.5, and ends at
        ``x`` if it is 1.
        """
        if not _is_seen(((x, y),)):
            return
        try:
            image = self._fonts[size].render(text, True, color)
        except (KeyError, self._pg.error):  # first text of this size, or other code quit pygame
            self._pg.font.init()
            self._fonts[size] = self._pg.font.Font(None, size * UNIT)
            image = self._fonts[size].render(text, True, color)
        width, height = image.get_size()
        self._canvas.blit(image, (round(x - align * width), round(y - 0.5 * height)))


CLIP = np.full(2, -float(AROUND)), np.array([WIDTH, HEIGHT], float) + AROUND
"""Corners with the least and the largest x and y to which shapes are clipped, in canvas pixels."""


def _is_seen(points: Corners, margin: float = 0.0) -> bool:
    """Return whether all points lie in the clipping rectangle, or at most ``margin`` outside it."""
    least = -AROUND - margin
    right = WIDTH + AROUND + margin
    low = HEIGHT + AROUND + margin
    if len(points) > MANY:
        array = np.asarray(points)
        return bool((array >= least).all() and (array <= (right, low)).all())
    # A loop takes less time than NumPy for a few points.
    return all(least <= x <= right and least <= y <= low for x, y in points)


def clip_polygon(points: Corners, low: Array, high: Array) -> Array:
    """Clip a polygon to a rectangle.

    The method of Sutherland and Hodgman (1974) clips the polygon at one side of the rectangle after
    the other.

    Args:
        points: Corners of the polygon, shape (n, 2).
        low: Corner of the rectangle with the least x and y, shape (2,).
        high: Corner of the rectangle with the largest x and y, shape (2,).

    Returns:
        Corners of the clipped polygon, shape (m, 2). There are none if the polygon is outside.
    """
    seen = _bounded(points)
    for axis in (0, 1):
        for way, bound in ((-1.0, low[axis]), (1.0, high[axis])):
            inside = way * seen[:, axis] <= way * bound
            if inside.all():
                continue
            following = np.roll(seen, -1, axis=0)
            crosses = inside != np.roll(inside, -1)
            change = np.where(crosses, following[:, axis] - seen[:, axis], 1.0)
            share = (bound - seen[:, axis]) / change
            cut = seen + np.where(crosses, share, 0.0)[:, None] * (following - seen)
            cut[:, axis] = bound
            both = np.stack([seen, cut], axis=1)
            seen = both[np.stack([inside, crosses], axis=1)]
    return seen


def clip_lines(points: Corners, low: Array, high: Array) -> Array:
    """Clip the lines from each point to the next to a rectangle.

    The method is that of Liang and Barsky (1984).

    Args:
        points: The points, shape (n, 2).
        low: Corner of the rectangle with the least x and y, shape (2,).
        high: Corner of the rectangle with the largest x and y, shape (2,).

    Returns:
        Start and end of each clipped line, without lines that are completely outside, shape (m, 2,
        2).
    """
    line = _bounded(points)
    start = line[:-1]
    way = np.diff(line, axis=0)
    still = way == 0.0
    safe = np.where(still, 1.0, way)
    ends = np.stack([(low - start) / safe, (high - start) / safe])
    outside = ((start < low) | (start > high)) & still
    enter = np.where(still, 0.0, ends.min(axis=0)).max(axis=1).clip(0.0, 1.0)
    leave = np.where(still, 1.0, ends.max(axis=0)).min(axis=1).clip(0.0, 1.0)
    seen = (enter < leave) & ~outside.any(axis=1)
    shares = np.stack([enter, leave], axis=-1)[seen, :, None]
    return np.asarray(start[seen, None] + shares * way[seen, None])


def circle(center: Array, radius: float) -> Array:
    """Return the outline of a disc as a polygon, in canvas pixels, shape (n, 2).

    The outline of a large disc contains only the part near the canvas. It has a corner at each of
    many columns of the canvas, because a polygon with few corners would not look round.
    """
    if radius <= ROUND:
        return np.asarray(center + radius * CIRCLE)
    (left, _), (right, _) = CLIP
    x = np.linspace(left, right, WIDTH // UNIT)
    beyond = np.abs(x - center[0])
    half = np.sqrt(np.maximum(radius - beyond, 0.0) * (radius + beyond))
    x = x.clip(center[0] - radius, center[0] + radius)
    upper = np.stack([x, center[1] - half], axis=-1)
    lower = np.stack([x, center[1] + half], axis=-1)
    return np.concatenate([upper, lower[::-1]])


def _bounded(points: Corners) -> Array:
    """Return points whose coordinates are clipped to FARTHEST, with 0 in place of NaN."""
    return np.clip(np.nan_to_num(np.asarray(points, dtype=float)), -FARTHEST, FARTHEST)


def _tick_spacing(width: float) -> float:
    """Return the distance between marks in m, for a visible part of the ground in m."""
    spacing = TICK_SPACING
    for factor in itertools.cycle((2.0, 2.5, 2.0)):  # 1, 2.5, 5, 10 ... m
        if width <= MOST_MARKS * spacing:
            break
        spacing *= factor
    return spacing


def _mark_label(mark: float, spacing: float) -> str:
    """Return the label of a mark, its position in m. Every other label contains the unit."""
    place = mark * spacing
    if spacing > TICK_SPACING or abs(place) > MOST_DIGITS:
        return f"{place:.7g}" if mark % 2 else f"{place:.7g} m"
    return f"{place:.1f}" if mark % 2 else f"{place:.0f} m"


def _number(value: float, digits: str = ".2f") -> str:
    """Return a number as text in a format, or with an exponent if it is large."""
    return format(value, digits if abs(value) < MOST_DIGITS else digits[:-3] + ".3g")


def reach_of(robot: Robot) -> float:
    """Return the largest distance of a joint from the crank axis over a turn, in m."""
    turn = joint_positions(robot, "fore", np.linspace(-math.pi, math.pi, 180))
    return float(np.hypot(turn[..., 0], turn[..., 1]).max())


def depths_of(robot: Robot) -> list[float]:
    """Return the depth of each leg in a picture, from 0 (the nearest) to 1 (the farthest)."""
    phases = [leg.phase % (2.0 * math.pi) for leg in robot.legs]
    layers = sorted(set(phases))  # phase 0, that of the first leg, is the nearest layer
    return [layers.index(phase) / max(1, len(layers) - 1) for phase in phases]


def _mix(color: Color, other: Color, share: float) -> Color:
    """Return a mixture of two colors, with a fraction ``share`` (0 to 1) of the second color."""
    r, g, b = (round(c + share * (o - c)) for c, o in zip(color, other, strict=True))
    return (r, g, b)
