// Six questions to learn from: each sets the page, says what to try, and has a number that answers.

import { shown } from "./walker.js";

const RECENT = 10; // s

const recent = ({ past, machine }, value) =>
  past.slice(-Math.round(RECENT / machine.layout.period)).map(({ info }) => value(info));
const mean = (values) => values.reduce((total, value) => total + value, 0) / values.length;

/** What took energy in the last 10 s, as shares. */
function losses(walker) {
  const names = ["joint_loss", "slip_loss", "impact_loss"];
  const means = names.map((name) => mean(recent(walker, ({ energy }) => energy[name])));
  const total = means.reduce((sum, value) => sum + value, 0);
  return means.map((value) => (total > 0 ? `${Math.round((100 * value) / total)} %` : "–"));
}

/** title, question, what to try; the page's address; the answer from the walkers. */
export const LESSONS = [
  {
    title: "One motor, one path",
    question: "How does a turning crank make a step?",
    trial: "Follow a toe in slow motion: it goes round one path, flat below. Try another robot.",
    address: "robot=built&control=constant+speed&command=0.15",
    answer([{ past, machine }]) {
      const { info } = past.at(-1);
      const turns = Math.abs(info.crank_angle - past[0].info.crank_angle) / (2 * Math.PI);
      const way = turns > 0.5 ? Math.abs(info.x_position - past[0].info.x_position) / turns : null;
      const most = Math.abs(machine.tables.advance);
      return `${shown(way, 2, " m")} a turn of the crank; ${shown(most, 2, " m")} if no toe slid.`;
    },
  },
  {
    title: "Why a toe slips",
    question: "Can it walk without slipping?",
    trial: "Two toes that stand are never equally fast for long. Change friction, walk at 0.5 m/s.",
    address: "robot=paper&control=constant+speed&command=0.1",
    answer: ([{ score }]) => `Its toes slide ${shown(score.slip, 2, " m")} a metre.`,
  },
  {
    title: "Torque over a turn",
    question: "How strong must the motor be?",
    trial: "Look at the torque: two peaks a turn. Add a payload, or a slope.",
    address: "robot=built&control=constant+speed&command=0.2",
    answer([walker]) {
      const torques = recent(walker, ({ crank_torque }) => Math.abs(crank_torque));
      const most = Math.max(...torques);
      return `At most ${shown(most, 1, " N m")}, in the mean ${shown(mean(torques), 1, " N m")}.`;
    },
  },
  {
    title: "What a policy learns",
    question: "What does a trained policy do that constant speed cannot?",
    trial: "Above the policy, below constant speed. Push both (space), and make them faster.",
    address: "robot2=built&control2=constant+speed&command=0.4",
    answer(walkers) {
      const [policy, constant] = walkers.map(({ score }) => shown(score.slip, 2, " m"));
      return `The policy's toes slide ${policy} a metre, the other's ${constant ?? "–"}.`;
    },
  },
  {
    title: "What lengths change",
    question: "Are Jansen's lengths the best?",
    trial: "Above the paper's lengths, below lengths that a search found. Try other speeds.",
    address: "control=constant+speed&robot2=economy&control2=constant+speed&command=0.15",
    answer(walkers) {
      const [paper, searched] = walkers.map(({ score }) => shown(score.cost, 2));
      return `Cost of transport: ${paper} with the paper's lengths, ${searched ?? "–"} with those found.`;
    },
  },
  {
    title: "Where the energy goes",
    question: "What is the motor's work used for on level ground?",
    trial: "Nothing is lifted in the end. Change friction, speed and slope.",
    address: "command=0.3",
    answer([walker]) {
      const [joints, slip, impacts] = losses(walker);
      return `Joints take ${joints}, slip ${slip}, impacts ${impacts}.`;
    },
  },
];
