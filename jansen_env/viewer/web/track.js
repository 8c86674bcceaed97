// A recording as the page has it: arrays as they were packed by page.py, and what they are at a time.
//
// Between control steps positions are interpolated for the eye; nothing is simulated.

/** Numbers of a packed array: base64 of float32. */
function unpack(data) {
  const bytes = Uint8Array.from(atob(data), (character) => character.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

/** What `page.py` packs of a recording, ready to be asked. */
export function trackOf(packed) {
  const { arrays, ...track } = packed;
  for (const [name, array] of Object.entries(arrays)) track[name] = unpack(array);
  track.legs = track.scene.phases.length;
  track.duration = track.time[track.time.length - 1];
  return track;
}

/** The control step that is going on at a time, s: the index of its end; 0 at the start. */
export function stepAt(track, time) {
  let low = 0;
  let high = track.time.length - 1;
  const exact = time - 1e-9 * track.duration;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (track.time[middle] >= exact) high = middle;
    else low = middle + 1;
  }
  return low;
}

/** What scene.js draws at a time, s; before the start and after the end as it is there. */
export function stateAt(track, time) {
  const { pose, joints, contact, contactPoint, contactForce, legs } = track;
  const k = stepAt(track, time);
  const before = Math.max(k - 1, 0);
  const length = track.time[k] - track.time[before];
  const share = length > 0 ? Math.min(Math.max((time - track.time[before]) / length, 0), 1) : 1;
  const between = (array, stride, i) => {
    const start = array[before * stride + i];
    return start + share * (array[k * stride + i] - start);
  };
  const [x, y, pitch] = [0, 1, 2].map((i) => between(pose, 4, i));
  // Points are kept relative to the crank axis.
  const point = (array, stride, i) => [
    x + between(array, stride, i),
    y + between(array, stride, i + 1),
  ];
  const count = track.scene.joints.length;
  const state = { x, y, pitch, joints: [], toes: [] };
  for (let leg = 0; leg < legs; leg++) {
    const places = [];
    for (let i = 0; i < count; i++)
      places.push(point(joints, 2 * count * legs, 2 * (count * leg + i)));
    state.joints.push(places);
  }
  const toes = track.scene.toes.length;
  for (let toe = 0; toe < toes; toe++) {
    const force = 2 * (k * toes + toe);
    state.toes.push({
      contact: contact[k * toes + toe],
      point: point(contactPoint, 2 * toes, 2 * toe),
      force: [contactForce[force], contactForce[force + 1]],
    });
  }
  return state;
}

/**
 * Where a toe has been in the `seconds` before a time: [{contact, points}], world frame, m, one for
 * each stretch in which it did the same.
 */
export function pathOf(track, toe, time, seconds) {
  const { pose, joints, contact, legs, scene } = track;
  const [leg, joint] = scene.toes[toe];
  const count = scene.joints.length;
  const last = stepAt(track, time);
  const pieces = [];
  for (let k = stepAt(track, time - seconds); k < last; k++) {
    const i = 2 * (count * (k * legs + leg) + joint);
    const point = [pose[4 * k] + joints[i], pose[4 * k + 1] + joints[i + 1]];
    const now = contact[(k + 1) * scene.toes.length + toe]; // of the step from here on
    pieces.at(-1)?.points.push(point);
    if (pieces.at(-1)?.contact !== now) pieces.push({ contact: now, points: [point] });
  }
  pieces.at(-1)?.points.push(stateAt(track, time).joints[leg][joint]);
  return pieces;
}

/** The numbers of a control step, by the names of `NUMBERS`; null where there is none. */
export function numbersAt(track, k) {
  const { pose } = track;
  const known = (value) => (Number.isNaN(value) ? null : value);
  return {
    command: track.command[k],
    speed: track.speed[k],
    crankSpeed: track.crankSpeed[k],
    torque: track.torque[k],
    power: track.power[k],
    slip: track.slip[k],
    position: pose[4 * k],
    pitch: pose[4 * k + 2],
    returned: track.returned[k],
    slipPerMetre: known(track.slipPerMetre[k]),
    costOfTransport: known(track.costOfTransport[k]),
  };
}
