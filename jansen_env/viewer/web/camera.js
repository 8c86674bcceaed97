// Where the pictures look: following the robots, or where the user has moved them.

import { followingView } from "./scene.js";

const [CLOSEST, FARTHEST] = [12, 0.15]; // zoom, 1 shows a robot

/**
 * A camera for all pictures of a page; `changed` is called when the user moves it.
 *
 * It stands beside the robots that it follows, or beside a place, by dx and dy, m.
 */
export function cameraFor(changed) {
  const camera = { following: true, zoom: 1, dx: 0, dy: 0, place: null };
  const drawn = new Map(); // canvas: its size and what it would show, when last drawn

  /** The view of a canvas with robots in these states; the first one's scene. */
  function viewOf(canvas, size, scene, states) {
    const places = states.map((state) => state.x);
    const [left, right] = [Math.min(...places), Math.max(...places)];
    const top = Math.max(...states.map((state) => state.y));
    const view = followingView(size, scene, { x: 0.5 * (left + right), y: top });
    const room =
      (right - left + scene.style.PICTURE_WIDTH * scene.reach) / (size.width / view.scale);
    if (room > 1) {
      view.y += ((room - 1) * size.height) / (2 * view.scale); // the ground stays below
      view.scale /= room;
    }
    drawn.set(canvas, { size, view });
    const { x, y } = camera.following ? view : camera.place;
    return { x: x + camera.dx, y: y + camera.dy, scale: camera.zoom * view.scale };
  }

  /** Zoom by a factor, about a pixel of a canvas; without one about its middle. */
  function zoomBy(factor, canvas, px, py) {
    const seen = drawn.get(canvas);
    if (!seen) return; // not drawn yet
    const { size, view } = seen;
    const before = camera.zoom;
    camera.zoom = Math.min(Math.max(before * factor, FARTHEST), CLOSEST);
    if (px !== undefined) {
      const nearer = 1 / (before * view.scale) - 1 / (camera.zoom * view.scale); // m per pixel
      camera.dx += (px - 0.5 * size.width) * nearer;
      camera.dy -= (py - 0.5 * size.height) * nearer;
    }
    changed();
  }

  /** Move the picture by pixels of a canvas. */
  function panBy(dx, dy, canvas) {
    const seen = drawn.get(canvas);
    if (!seen) return;
    const scale = camera.zoom * seen.view.scale;
    camera.dx -= dx / scale;
    camera.dy += dy / scale;
    changed();
  }

  /** Follow the robots, or stay where a canvas looks now. */
  function follow(on, canvas) {
    if (!on && !drawn.has(canvas)) return;
    if (!on) camera.place = drawn.get(canvas).view;
    camera.following = on;
    changed();
  }

  /** Show all of the robots, and follow them. */
  function fit() {
    Object.assign(camera, { following: true, zoom: 1, dx: 0, dy: 0 });
    changed();
  }

  /** Let wheel, mouse and fingers move the camera over a canvas. */
  function listen(canvas) {
    const fingers = new Map();
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        const lines = event.deltaMode === 1 ? 16 : 1;
        zoomBy(Math.exp(-0.0016 * lines * event.deltaY), canvas, ...place(event));
      },
      { passive: false },
    );
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, place(event));
    });
    canvas.addEventListener("pointermove", (event) => {
      const from = fingers.get(event.pointerId);
      if (!from) return;
      const to = place(event);
      if (fingers.size === 1) panBy(to[0] - from[0], to[1] - from[1], canvas);
      if (fingers.size === 2) {
        const [[, other]] = [...fingers].filter(([id]) => id !== event.pointerId);
        const apart = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
        zoomBy(apart(to) / apart(from), canvas, 0.5 * (to[0] + other[0]), 0.5 * (to[1] + other[1]));
      }
      fingers.set(event.pointerId, to);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    }
  }

  return { camera, viewOf, zoomBy, panBy, follow, fit, listen };
}
