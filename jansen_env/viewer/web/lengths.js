// Changes the lengths of a robot with the kernels of jansen_env/engine/link_shapes.py.

import { Leg, linkOf } from "./robot.js";

/**
 * Return a design of data.robots with some other lengths, in m, by the names of data.designs. A robot
 * of built parts gets built parts of the new lengths; other links keep their mass per metre of their
 * sides.
 */
export function robotWithLengths({ work }, data, base, changed) {
  const robot = data.robots[base];
  const design = data.designs[base];
  const { names, lengths: known, parts } = design;
  const lengths = { ...known, ...changed };
  const wrong = names.flat().find((name) => !Number.isFinite(lengths[name]));
  if (wrong) throw new Error(`lengths['${wrong}'] must be a finite number, got ${lengths[wrong]}`);
  return work.scratch(() => {
    const made = resizer(work, new Leg(work, robot), { ...design, robot });
    const fault = made.resize(lengths);
    if (fault >= 0) {
      const sides = names[fault].map((name) => lengths[name]).join(", ");
      const [body] = robot.linkage.bodies[fault];
      throw new Error(`lengths of ${body}: sides must form a triangle, got (${sides}) m`);
    }
    const isNew = (k) => names[k].some((name) => lengths[name] !== known[name]);
    const bodies = robot.bodies.map((link, k) =>
      parts || isNew(k) ? linkOf(made.links, made.points, k, link) : link,
    );
    return { ...robot, bodies, frame_angle: lengths.frame_angle };
  });
}

/**
 * Return an object that changes the lengths of a leg's links in its memory: {links, points, resize}.
 * `resize` returns the body whose sides form no triangle, or -1.
 */
export function resizer(memory, leg, { names, lengths: known, parts, robot }) {
  const most = Math.max(...names.map((ofBody) => ofBody.length));
  const rowsOf = () => memory.array("f8", names.length, most);
  const fill = (rows, lengths) => {
    for (const [k, ofBody] of names.entries())
      rows.at(k).view.set(ofBody.map((name) => lengths[name]));
  };
  const [wanted, before] = [rowsOf(), rowsOf()];
  fill(before, known);
  const links = memory.array("LINK", ...leg.links.shape);
  const points = memory.array("f8", ...leg.points.shape);
  const work = memory.array("f8", 2, leg.points.shape[1] + 1, 2);
  const given = [leg.links, leg.points, leg.members, wanted, before, Number(!parts)];
  const build = memory.array("BUILD", 1);
  build.write(memory.layout.build);
  const built = parts && memory.filled("i8", parts);
  const resize = (lengths) => {
    fill(wanted, lengths);
    const fault = memory.call("link_shapes_resize", given, links, points, work);
    if (built && fault < 0)
      memory.call("link_shapes_put_built_parts", links, points, built, robot.legs.length, build);
    return fault;
  };
  return { links, points, resize };
}
