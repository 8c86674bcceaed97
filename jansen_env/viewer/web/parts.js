// Mass and inertia of the built robot's parts, bit for bit as jansen_env/robot/buildable.py has them.

/** A flat bar with round ends about two pins, and a mass on each: {mass, inertia}. */
export function flatBar(length, width, end, { DENSITY, BAR_THICKNESS }) {
  const [radius, areal, span] = [0.5 * width, DENSITY * BAR_THICKNESS, length * length];
  const [middle, rounds] = [areal * length * width, areal * Math.PI * radius * radius];
  const beyond = (length * 4 * radius) / (3 * Math.PI);
  const inertia =
    (middle * (span + width * width)) / 12 +
    rounds * (0.5 * radius * radius + 0.25 * span + beyond);
  return { mass: middle + rounds + 2 * end, inertia: inertia + 0.5 * end * span };
}

/** A windowed plate about the triangle of its pins, with more mass on the third: {mass, inertia}. */
export function triangularPlate(
  [a, b, c],
  more,
  { DENSITY, PLATE_THICKNESS, OUTLINE, WINDOW, PIN_SHARE },
) {
  const half = 0.5 * (a + b + c);
  const area = Math.sqrt(half * (half - a) * (half - b) * (half - c));
  const spread = (a * a + b * b + c * c) / 36;
  const areal = DENSITY * PLATE_THICKNESS;
  const [outline, window] = [OUTLINE * OUTLINE, WINDOW * WINDOW];
  let inertia = areal * area * spread * (outline * outline - window * window);
  const mass = areal * area * (outline - window);
  const reach = Math.sqrt(2 * (b * b + c * c) - a * a) / 3; // of the third corner
  const [moment, hole] = [more * reach, areal * area * window];
  inertia += moment * reach - (moment * moment) / hole;
  return { mass: mass + 3 * PIN_SHARE + more, inertia: inertia + PIN_SHARE * 12 * spread };
}
