// Draws one state of a robot on a canvas: ground, legs, chassis, payload, toes and forces.
//
// What is drawn, and how, is as in jansen_env/world/rendering.py; positions come from Python
// (geometry.py), and so do the sizes in `style`. Lengths in m, forces in N, sizes in CSS pixels.
// `view` = {x, y, scale}: the world point in the middle of the canvas, and pixels per m.

const NOMINAL_SCALE = 325; // pixels per reach at which line widths are as they are given
const CROWDED = 46; // pixels between marks, at least
export const [AIR, GRIP, SLIP] = [0, 1, 2]; // what a toe does, as in rendering.py

export const THEMES = {
  light: {
    sky: [241, 246, 251],
    grid: [222, 231, 240],
    ground: [234, 223, 202],
    surface: [150, 128, 94],
    groundText: [104, 86, 58],
    ink: [38, 50, 66],
    muted: [100, 112, 128],
    paper: [255, 255, 255],
    link: [58, 124, 190],
    crank: [240, 140, 16],
    force: [124, 58, 190],
    spring: [146, 84, 20],
    grip: [0, 140, 122],
    slip: [220, 38, 38],
  },
  dark: {
    sky: [15, 21, 29],
    grid: [29, 39, 51],
    ground: [45, 40, 33],
    surface: [158, 136, 102],
    groundText: [190, 172, 138],
    ink: [216, 226, 238],
    muted: [142, 155, 172],
    paper: [15, 21, 29],
    link: [88, 158, 230],
    crank: [255, 166, 54],
    force: [186, 134, 255],
    spring: [226, 172, 96],
    grip: [36, 200, 172],
    slip: [255, 92, 92],
  },
};

/**
 * Return what is drawn of a robot, the content of a robot file; geometry.py documents the fields.
 * `reach` is the distance of the farthest joint from the crank axis, in m.
 */
export function sceneOf(robot, reach, style) {
  const { linkage, legs, pad_radius: padRadius, payload: load } = robot;
  const springs = springsOf(robot, style);
  const indicesOf = (letters) => [...letters].map((joint) => linkage.joints.indexOf(joint));
  const [x, y] = load.position;
  return {
    style,
    joints: linkage.joints,
    bodies: linkage.bodies.map(([, letters]) => indicesOf(letters)),
    phases: legs.map(({ phase }) => phase),
    toes: legs.flatMap((_, leg) => indicesOf(linkage.toes).map((joint) => [leg, joint])),
    padRadius,
    reach,
    payload: load.mass > 0 ? { mass: load.mass, x, y } : null,
    ...(springs.length > 0 ? { springs } : {}),
  };
}

/** Springs of all legs: `drawn_springs` of drawn_springs.py. */
function springsOf({ linkage, legs, springs = [] }, style) {
  const indexOf = (joint) => linkage.joints.indexOf(joint);
  const members = new Map(linkage.bodies.map(([name, letters]) => [name, [...letters]]));
  const drawn = (spring, leg, side) => {
    const { is, start, end, first, second, anchor = [0, 0] } = spring;
    if (is === "TorsionSpring") {
      const links = [members.get(first), members.get(second)];
      const pin = links[0].find((joint) => links[1].includes(joint));
      const others = links.map((link) => link.find((joint) => joint !== pin));
      return { leg, joints: [pin, ...others].map(indexOf), anchor: null };
    }
    if (end) return { leg, joints: [indexOf(start), indexOf(end)], anchor: null };
    const x = side === "fore" ? anchor[0] : -anchor[0];
    return { leg, joints: [indexOf(start)], anchor: [x, anchor[1]] };
  };
  return legs
    .flatMap(({ side }, leg) => springs.map((spring) => drawn(spring, leg, side)))
    .slice(0, style.MOST_SPRINGS);
}

const texts = new Map(); // of colours that have been asked for, by their numbers

/** A theme's colour as CSS. */
export function css([red, green, blue], alpha = 1) {
  const [r, g, b] = [Math.round(red), Math.round(green), Math.round(blue)];
  const key = ((r * 256 + g) * 256 + b) * 128 + 100 * alpha;
  if (!texts.has(key)) texts.set(key, `rgba(${r},${g},${b},${alpha})`);
  return texts.get(key);
}

/** `color` with `share` of it (0 to 1) replaced by `other`. */
export function mix(color, other, share) {
  return color.map((value, i) => value + share * (other[i] - value));
}

/** Height of the ground at x, m; its first and last segment go on beyond its ends. */
export function heightAt(terrain, x) {
  let low = 0;
  let high = terrain.length - 2;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (terrain[middle][0] <= x) low = middle;
    else high = middle - 1;
  }
  const [[x0, y0], [x1, y1]] = [terrain[low], terrain[low + 1]];
  return y0 + ((x - x0) * (y1 - y0)) / (x1 - x0);
}

/** The view that follows a robot as the renderer's does; `zoom` 1 shows all of it. */
export function followingView(size, scene, state, zoom = 1) {
  const { reach, terrain, style } = scene;
  const { PICTURE_HEIGHT, PICTURE_WIDTH, NEARBY, NEARBY_POINTS: count } = style;
  const scale = Math.min(
    size.height / (PICTURE_HEIGHT * reach),
    size.width / (PICTURE_WIDTH * reach),
  );
  let level = state.y - style.AXIS_HEIGHT * reach;
  if (terrain) {
    // The mean height nearby keeps the picture steady where the ground is rough.
    const ways = Array.from({ length: count }, (_, i) => (2 * i) / (count - 1) - 1);
    const heights = ways.map((way) => heightAt(terrain, state.x + NEARBY * reach * way));
    level = heights.reduce((sum, height) => sum + height) / count;
    level = Math.min(Math.max(level, state.y - reach), state.y);
  }
  const bottom = level - style.DEPTH_BELOW * reach;
  return { x: state.x, y: bottom + (0.5 * size.height) / scale, scale: zoom * scale };
}

/**
 * Draw ground and robot.
 *
 * ctx: a canvas' 2D context, scaled so that 1 is a CSS pixel. size: {width, height} in these.
 * scene, state: of geometry.py. view: see above.
 * options: {theme: of THEMES, forces: whether arrows are drawn, paths: [{points, color}] of toes
 * (points: [[x, y] ...] or null for a gap)}.
 */
export function drawScene(ctx, size, scene, state, view, options = {}) {
  drawGround(ctx, size, scene, view, options);
  drawRobot(ctx, size, scene, state, view, options);
}

/** Metres between marks: 1, 2 or 5 times a power of ten. */
function tickSpacing(scale) {
  const power = 10 ** Math.floor(Math.log10(CROWDED / scale));
  return power * [1, 2, 5, 10].find((factor) => factor * power * scale >= CROWDED * (1 - 1e-9));
}

/** Digits after the point that multiples of a step need. */
export function digitsOf(step) {
  return Math.min(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), 9);
}

/** Draw sky, grid and ground with marks every so many metres. */
export function drawGround(ctx, size, scene, view, { theme = THEMES.light } = {}) {
  const { width, height } = size;
  const at = pixels(size, view);
  ctx.fillStyle = css(theme.sky);
  ctx.fillRect(0, 0, width, height);
  const spacing = tickSpacing(view.scale);
  const left = view.x - (0.5 * width) / view.scale;
  const right = view.x + (0.5 * width) / view.scale;
  const marks = [];
  for (let i = Math.ceil(left / spacing) - 1; i * spacing < right + spacing; i++) marks.push(i);
  ctx.strokeStyle = css(theme.grid);
  ctx.lineWidth = 1;
  const verticals = marks.map((mark) => at([mark * spacing, 0])[0]);
  lines(
    ctx,
    verticals.map((x) => [
      [x, 0],
      [x, height],
    ]),
  );
  const { terrain } = scene;
  if (!terrain) return;
  const inside = terrain.filter(([x]) => x > left && x < right);
  const surface = [
    [left, heightAt(terrain, left)],
    ...inside,
    [right, heightAt(terrain, right)],
  ].map(at);
  ctx.fillStyle = css(theme.ground);
  polygon(ctx, [...surface, [width, height + 1], [0, height + 1]]);
  ctx.strokeStyle = css(theme.surface);
  ctx.fillStyle = css(theme.groundText);
  ctx.font = "11px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  const digits = digitsOf(spacing);
  for (const mark of marks) {
    const [x, y] = at([mark * spacing, heightAt(terrain, mark * spacing)]);
    const main = mark % 2 === 0;
    ctx.lineWidth = 1.6;
    line(ctx, [x, y], [x, y + (main ? 11 : 7)]);
    if (!main) continue;
    const label = `${(mark * spacing).toFixed(digits).replace(/^-(0\.?0*)$/, "$1")} m`;
    const half = 0.5 * ctx.measureText(label).width;
    const fits = x >= half && x <= width - half && y + 26 <= height;
    if (fits) ctx.fillText(label, x, y + 15); // a label that is cut can be misread
  }
  ctx.lineWidth = 2.5;
  ctx.lineJoin = "round";
  path(ctx, surface);
  ctx.stroke();
}

/** Draw the robot alone; options as of drawScene, and `ghost`: a colour to draw it faintly in. */
export function drawRobot(ctx, size, scene, state, view, options = {}) {
  const theme = options.ghost
    ? ghostly(options.theme ?? THEMES.light, options.ghost)
    : (options.theme ?? THEMES.light);
  const at = pixels(size, view);
  const zoom = Math.min(Math.max((view.scale * scene.reach) / NOMINAL_SCALE, 0.4), 3);
  const brush = { ctx, theme, zoom, at, scene, view };
  ctx.lineCap = "round";
  ctx.lineJoin = "round";
  for (const { points, color } of options.paths ?? []) drawPath(brush, points, color);
  const legs = state.joints.map((joints) => joints.map(at));
  const depths = depthsOf(scene.phases);
  const order = [...depths.keys()].sort((a, b) => depths[b] - depths[a]);
  const draw = (i) => {
    drawLeg(brush, legs[i], depths[i]);
    drawSprings(brush, legs[i], i, depths[i], state);
  };
  for (const i of order) if (depths[i] > 0) draw(i);
  drawChassis(brush, legs, state);
  for (const i of order) if (depths[i] === 0) draw(i);
  for (const i of order)
    scene.toes.forEach(([leg, joint], toe) => {
      if (leg !== i) return;
      const { contact, point, force } = state.toes[toe];
      if (options.forces !== false) drawForce(brush, at(point), force);
      drawToe(brush, legs[leg][joint], contact);
    });
}

/** Depths of legs by their phases, from 0, the nearest, which is phase 0's, to 1, the farthest. */
function depthsOf(phases) {
  const turned = phases.map((phase) => (phase + 2 * Math.PI) % (2 * Math.PI));
  const layers = [...new Set(turned)].sort((a, b) => a - b);
  return turned.map((phase) => layers.indexOf(phase) / Math.max(1, layers.length - 1));
}

/** A theme in which a robot is but a shade of a colour. */
function ghostly(theme, color) {
  const faint = mix(color, theme.sky, 0.5);
  const crank = mix(color, theme.sky, 0.25);
  return { ...theme, ink: faint, link: faint, crank, muted: faint, spring: faint };
}

/** A function from places, m, to pixels. */
export function pixels(size, view) {
  const [x0, y0] = [0.5 * size.width, 0.5 * size.height];
  return ([x, y]) => [x0 + (x - view.x) * view.scale, y0 - (y - view.y) * view.scale];
}

function drawPath({ ctx, at }, points, color) {
  ctx.strokeStyle = color;
  ctx.lineWidth = 1.8;
  path(ctx, points.map(at));
  ctx.stroke();
}

function drawLeg({ ctx, theme, zoom, scene }, joints, depth) {
  const fade = 0.58 * Math.sqrt(depth);
  const [ink, fill, crank] = [theme.ink, theme.link, theme.crank].map((color) =>
    mix(color, theme.sky, fade),
  );
  const [, shaft, ...others] = scene.bodies.map((body) => body.map((joint) => joints[joint]));
  ctx.fillStyle = css(fill, depth ? 0.24 : 0.37);
  for (const corners of others) if (corners.length > 2) polygon(ctx, corners);
  ctx.strokeStyle = css(ink);
  ctx.lineWidth = zoom * (5 - depth);
  lines(ctx, others.flatMap(edgesOf));
  ctx.strokeStyle = css(crank);
  ctx.lineWidth = zoom * (8 - 2 * depth);
  lines(ctx, edgesOf(shaft));
  const pins = joints.filter((_, i) => !scene.toes.some(([, joint]) => joint === i));
  discs(ctx, pins, zoom * (4.2 - 0.6 * depth), css(ink));
  discs(ctx, pins, zoom * (2.3 - 0.4 * depth), css(theme.paper));
}

/** Draw the springs of a leg, with a disc at each end. */
function drawSprings({ ctx, theme, zoom, at, scene }, joints, leg, depth, { x, y, pitch }) {
  const color = css(mix(theme.spring, theme.sky, 0.58 * Math.sqrt(depth)));
  const [cos, sin] = [Math.cos(pitch), Math.sin(pitch)];
  for (const spring of scene.springs ?? []) {
    if (spring.leg !== leg) continue;
    const places = spring.joints.map((joint) => joints[joint]);
    if (spring.anchor) {
      const [u, v] = spring.anchor;
      places.push(at([x + cos * u - sin * v, y + sin * u + cos * v]));
    }
    const points =
      places.length === 3
        ? spiral(...places, scene.style.SPIRAL_RADIUS * zoom, scene.style)
        : coil(...places, scene.style.COIL_WIDTH * zoom, scene.style);
    ctx.strokeStyle = color;
    ctx.lineWidth = 2.2 * zoom;
    path(ctx, points);
    ctx.stroke();
    discs(ctx, [points[0], points.at(-1)], 2.6 * zoom, color);
  }
}

/** The zigzag line of a linear spring, in pixels. */
export function coil([x0, y0], [x1, y1], width, { COILS, LEAD }) {
  const [dx, dy] = [x1 - x0, y1 - y0];
  const length = Math.hypot(dx, dy);
  const [sx, sy] = length > 0 ? [-dy / length, dx / length] : [0, 1];
  const point = (share, offset) => [x0 + share * dx + offset * sx, y0 + share * dy + offset * sy];
  const points = [point(0, 0), point(LEAD, 0)];
  const peaks = 2 * COILS;
  for (let k = 0; k < peaks; k++)
    points.push(
      point(LEAD + ((1 - 2 * LEAD) * (k + 0.5)) / peaks, (k % 2 === 0 ? 0.5 : -0.5) * width),
    );
  return [...points, point(1 - LEAD, 0), point(1, 0)];
}

/** The spiral of a torsion spring, in pixels, from the first link to the second. */
export function spiral([x, y], first, second, radius, { TURNS, SPIRAL_POINTS }) {
  const [begin, end] = [first, second].map(([u, v]) => Math.atan2(v - y, u - x));
  const turned = ((end - begin + 4 * Math.PI) % (2 * Math.PI)) + 2 * Math.PI * TURNS;
  const points = [];
  for (let k = 0; k <= SPIRAL_POINTS; k++) {
    const share = k / SPIRAL_POINTS;
    const angle = begin + share * turned;
    const reach = radius * (0.5 + 0.5 * share);
    points.push([x + reach * Math.cos(angle), y + reach * Math.sin(angle)]);
  }
  return points;
}

function drawChassis({ ctx, theme, zoom, at, scene }, legs, { x, y, pitch }) {
  const [frame, [axis]] = scene.bodies;
  const load = scene.payload;
  if (load) {
    const { PAYLOAD_SIDE, PAYLOAD_SIDES, LARGEST_PAYLOAD } = scene.style;
    const [least, most] = PAYLOAD_SIDES;
    const usual = Math.min(Math.max(PAYLOAD_SIDE * Math.cbrt(load.mass), least), most);
    const half = Math.min(usual, LARGEST_PAYLOAD * scene.reach);
    const [cos, sin] = [Math.cos(pitch), Math.sin(pitch)];
    const placed = (dx, dy) => {
      const [u, v] = [load.x + dx * half, load.y + dy * half];
      return at([x + cos * u - sin * v, y + sin * u + cos * v]);
    };
    ctx.strokeStyle = css(theme.muted);
    ctx.lineWidth = 6 * zoom;
    const center = placed(0, 0);
    line(ctx, legs[0][axis], center);
    const corners = [placed(-1, -0.6), placed(1, -0.6), placed(1, 0.6), placed(-1, 0.6)];
    ctx.fillStyle = css(mix(theme.muted, theme.paper, 0.6));
    polygon(ctx, corners);
    ctx.lineWidth = 2.5 * zoom;
    path(ctx, corners);
    ctx.closePath();
    ctx.stroke();
    ctx.fillStyle = css(theme.ink);
    ctx.font = `${Math.round(11 * zoom)}px system-ui, sans-serif`;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    ctx.fillText(`${Number(load.mass.toPrecision(3))} kg`, ...center);
  }
  for (const [width, color] of [
    [9, theme.ink],
    [5, mix(theme.ink, theme.link, 0.55)],
  ]) {
    ctx.strokeStyle = css(color);
    ctx.lineWidth = width * zoom;
    lines(
      ctx,
      legs.flatMap((joints) => edgesOf(frame.map((joint) => joints[joint]))),
    );
  }
}

/** A toe pad: hollow in the air, else solid with a halo. */
function drawToe({ ctx, theme, zoom, scene, view }, center, contact) {
  const radius = Math.max(scene.padRadius * view.scale, 4.5 * zoom);
  if (contact === AIR) {
    disc(ctx, center, radius, css(theme.ink));
    disc(ctx, center, radius - 1.8 * zoom, css(theme.paper));
    return;
  }
  const color = contact === SLIP ? theme.slip : theme.grip;
  disc(ctx, center, 2.1 * radius, css(color, 0.33));
  disc(ctx, center, radius + zoom, css(theme.paper));
  disc(ctx, center, radius, css(color));
}

function drawForce({ ctx, theme, zoom, scene, view }, [x, y], force) {
  const size = Math.hypot(...force);
  const { ARROW_PER_WEIGHT, ARROW_PER_REACH, LONGEST_ARROW } = scene.style;
  const [least, most] = ARROW_PER_REACH.map((share) => share * scene.reach);
  const perWeight = Math.min(Math.max(ARROW_PER_WEIGHT, least), most);
  const length = Math.min(size / scene.weight, LONGEST_ARROW) * perWeight * view.scale;
  if (!(length >= 4)) return;
  const [ux, uy] = [force[0] / size, -force[1] / size];
  const head = Math.min(12 * zoom, 0.6 * length);
  const neck = [x + (length - head) * ux, y + (length - head) * uy];
  ctx.strokeStyle = ctx.fillStyle = css(theme.force);
  ctx.lineWidth = 3.4 * zoom;
  line(ctx, [x, y], neck);
  const side = 0.45 * head;
  polygon(ctx, [
    [x + length * ux, y + length * uy],
    [neck[0] - side * uy, neck[1] + side * ux],
    [neck[0] + side * uy, neck[1] - side * ux],
  ]);
}

// Primitives, in pixels.

function path(ctx, points) {
  ctx.beginPath();
  for (const [x, y] of points) ctx.lineTo(x, y);
}

function polygon(ctx, points) {
  path(ctx, points);
  ctx.closePath();
  ctx.fill();
}

/** Edges of a body with these corners: one, or all the way round. */
const edgesOf = (corners) =>
  corners.map((corner, k) => [corners.at(k - 1), corner]).slice(corners.length === 2 ? 1 : 0);

/** Lines [start, end] in one stroke. */
function lines(ctx, ends) {
  ctx.beginPath();
  for (const [[x, y], [u, v]] of ends) {
    ctx.moveTo(x, y);
    ctx.lineTo(u, v);
  }
  ctx.stroke();
}

export const line = (ctx, start, end) => lines(ctx, [[start, end]]);

/** Discs of a colour in one filling. */
function discs(ctx, centres, radius, color) {
  const size = Math.max(radius, 0);
  ctx.fillStyle = color;
  ctx.beginPath();
  for (const [x, y] of centres) {
    ctx.moveTo(x + size, y);
    ctx.arc(x, y, size, 0, 2 * Math.PI);
  }
  ctx.fill();
}

const disc = (ctx, centre, radius, color) => discs(ctx, [centre], radius, color);
