// Where the pictures look: following the robots, or where the user has moved them.

import { followingView, worldOf } from "./scene.js";

const [CLOSEST, FARTHEST] = [12, 0.15]; // zoom, 1 shows a robot

/** A camera for all pictures of a page; `changed` is called when the user moves it. */
export function cameraFor(changed) {
  const camera = { following: true, zoom: 1, x: 0, y: 0, scale: 1 };
  const nominal = new Map(); // canvas: its size and its view of zoom 1 when last drawn
  const bounded = (zoom) => Math.min(Math.max(zoom, FARTHEST), CLOSEST);

  /** The view of a canvas with robots in these states; the first one's scene. */
  function viewOf(canvas, size, scene, states) {
    const [left, right] = [Math.min, Math.max].map((of) => of(...states.map(({ x }) => x)));
    const middle = { x: 0.5 * (left + right), y: Math.max(...states.map(({ y }) => y)) };
    const view = followingView(size, scene, middle, 1);
    const room = (right - left + 2.3 * scene.reach) / (size.width / view.scale);
    if (room > 1) {
      view.y += ((room - 1) * size.height) / (2 * view.scale); // the ground stays below
      view.scale /= room;
    }
    nominal.set(canvas, { size, view });
    if (camera.following) return { ...view, scale: camera.zoom * view.scale };
    return { x: camera.x, y: camera.y, scale: camera.zoom * view.scale };
  }

  /** Stand where a canvas looks now. */
  function release(canvas) {
    if (!camera.following) return;
    const { view } = nominal.get(canvas);
    Object.assign(camera, { following: false, x: view.x, y: view.y });
  }

  /** Zoom by a factor, about a pixel of a canvas unless the camera follows. */
  function zoomBy(factor, canvas, px, py) {
    const { size, view } = nominal.get(canvas);
    const before = camera.zoom;
    camera.zoom = bounded(before * factor);
    if (!camera.following && px !== undefined) {
      const old = { ...camera, scale: before * view.scale };
      const fresh = { ...camera, scale: camera.zoom * view.scale };
      const [x0, y0] = worldOf(size, old, px, py);
      const [x1, y1] = worldOf(size, fresh, px, py);
      camera.x += x0 - x1;
      camera.y += y0 - y1;
    }
    changed();
  }

  /** Move the picture by pixels of a canvas. */
  function panBy(dx, dy, canvas) {
    release(canvas);
    const scale = camera.zoom * nominal.get(canvas).view.scale;
    camera.x -= dx / scale;
    camera.y += dy / scale;
    changed();
  }

  function follow(on, canvas) {
    if (on) camera.following = true;
    else release(canvas);
    changed();
  }

  function fit() {
    Object.assign(camera, { following: true, zoom: 1 });
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
