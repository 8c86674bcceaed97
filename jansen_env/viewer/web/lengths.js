// The same robot with other lengths, by the kernels of jansen_env/engine/link_shapes.py.

import { linkOf, linksOf } from "./robot.js";

/**
 * A design of data.robots with some other lengths, m, by the names of data.designs. Of the built
 * robot's parts it gets such parts; else links are as heavy per metre of their sides as before.
 */
export function robotWithLengths({ work, layout }, data, base, changed) {
  const robot = data.robots[base];
  const { lengths: known, names } = data.designs[base];
  const lengths = { ...known, ...changed };
  for (const [k, ofBody] of names.entries())
    if (!ofBody.every((name) => Number.isFinite(lengths[name])))
      throw new Error(`lengths of ${robot.linkage.bodies[k][0]} are missing`);
  return work.scratch(() => {
    const parts = data.built[base];
    const { links, points, fault } = resize(
      work,
      linksOf(work, robot),
      names,
      lengths,
      known,
      !parts,
    );
    if (fault >= 0)
      throw new Error(`the sides of ${robot.linkage.bodies[fault][0]} form no triangle`);
    const isNew = (k) => names[k].some((name) => lengths[name] !== known[name]);
    if (parts && names.some((_, k) => isNew(k))) {
      const build = work.array("BUILD", 1);
      build.write(layout.build);
      const ofBodies = [links, points, work.filled("i8", parts)];
      work.call("link_shapes_put_built_parts", ofBodies, robot.legs.length, build);
    }
    const bodies = robot.bodies.map((link, k) =>
      parts || isNew(k) ? linkOf(links, points, k, link) : link,
    );
    return { ...robot, bodies, frame_angle: lengths.frame_angle };
  });
}

/** Links with other lengths in a memory: {links, points, fault: the body that is no triangle or -1}. */
export function resize(memory, [links, points, members], names, lengths, known, dense) {
  const rows = (named) => {
    const most = Math.max(...names.map((ofBody) => ofBody.length));
    const out = memory.array("f8", names.length, most);
    for (const [k, ofBody] of names.entries())
      out.at(k).view.set(ofBody.map((name) => named[name]));
    return out;
  };
  const resized = memory.array("LINK", ...links.shape);
  const places = memory.array("f8", ...points.shape);
  const work = memory.array("f8", 2, points.shape[1] + 1, 2);
  const given = [links, points, members, rows(lengths), rows(known), Number(dense)];
  const fault = memory.call("link_shapes_resize", given, resized, places, work);
  return { links: resized, points: places, fault };
}
