// What the words of the pages mean.

/** Meanings of words, in one sentence each. */
// biome-ignore format: a table
const TERMS = {
  distance: "Way walked in the commanded direction, until a fall.",
  "slip per metre": "Metres that all toes have slid while they carry load, per metre walked.",
  "cost of transport": "Work of the motor per weight and distance; at 1 the work would lift the robot as far as it has walked.",
  "mean speed": "Mean of the last strides.",
  torque: "Torque of the motor on the crank.",
  "speed command": "Speed at which the controller is asked to walk; below 0 backwards.",
  control: "What turns the crank: your hand, a PID controller at a constant speed, or a policy that was trained to walk.",
  pace: "How fast time passes.",
  friction: "Coefficient of friction: a toe holds up to this share of its load.",
  payload: "Mass that the chassis carries.",
  restitution: "Share of its speed at which a toe bounces off the ground.",
  slope: "Angle of the ground, by which gravity is turned.",
  "motor strength": "Torque limit of the motor, as a share of its own.",
  "commanded speed": "Speed at which the controller is asked to walk.",
  "crank torque": "Torque of the motor on the crank, mean of the control step.",
  "motor power": "Torque times speed of the crank; below 0 the motor brakes.",
  "slip speed, all toes": "Sum of the speeds at which toes slide while they carry load.",
  "ground load": "Force of the ground on all toes together, across the ground, per weight: 1 for a robot that stands.",
  "compare with": "A second machine on the same ground, with the same command.",
  pitch: "Angle of the chassis, positive with its front up.",
  return: "Sum of the rewards.",
  lift: "The most that a toe comes above the ground.",
  advance: "Way in a turn of the crank.",
  heave: "By how much the crank's axis rises and falls.",
  height: "Mean height of the crank's axis above the ground.",
  "dead point": "Smallest angle between two links that meet in a joint, where they jam at 0°; the joint, the crank's angle there (violet), and its sine.",
};

/**
 * Have words explain themselves: by hovering over them, and by a tap or the focus (theme.css).
 * `meanings`: of more words.
 */
export function explain(selector, meanings = {}) {
  const terms = { ...meanings, ...TERMS };
  for (const word of document.querySelectorAll(selector)) {
    const title = terms[word.firstChild?.textContent.trim().replace(/ so far$/, "")];
    if (!title) continue;
    word.classList.add("term");
    Object.assign(word, { title, tabIndex: 0 });
    word.onclick = (event) => {
      event.preventDefault(); // a label's own control is not meant
      word.focus();
    };
  }
}
