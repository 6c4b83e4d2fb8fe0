// The robot's mechanics: the programs that twistwrench made for it, and what is put on it by hand, a payload and a push.
"use strict";

const NO_WRENCH = [0, 0, 0, 0, 0, 0];
const compiled = (text) => new Function(text.replace("export function", "return function"))();

class Mechanics {
  constructor(robot) {
    this.robot = robot;
    this.run = {};
    for (const [name, text] of Object.entries(robot.programs)) this.run[name] = compiled(text);
    this.mass = 0; // at the tip [kg]
    this.push = [0, 0, 0]; // on the tip, in the base's axes [N]
    this.still = robot.wrenchFrames.map(() => NO_WRENCH);
    const names = robot.frames.map((frame) => frame.name);
    this.given = robot.wrenchFrames.map((name) => {
      const mine = robot.wrenches.find((wrench) => names[wrench.frame] === name);
      return mine ? [...mine.moment, ...mine.force] : NO_WRENCH;
    });
    this.pushed = robot.payload === null ? -1 : robot.wrenchFrames.indexOf(names[robot.tip]);
  }

  get load() { // the last input of the programs that have one
    return this.robot.payload === null ? [] : [[this.mass]];
  }

  // T_s,body of every body.
  poses(q) {
    if (!this.robot.bodies.length) return [];
    const T = this.run.poses(q);
    return this.robot.bodies.map((_, k) => Array.from(T.subarray(16 * k, 16 * k + 16)));
  }

  tipPose(poses) {
    const tip = this.robot.frames[this.robot.tip];
    return mul(poseOf(poses, tip.body), tip.pose);
  }

  // The wrenches on the robot, each in its own frame: those given, and the push.
  wrenches(q) {
    if (this.pushed < 0 || !this.push.some((x) => x)) return this.given;
    const all = this.given.slice(), mine = all[this.pushed], f = turnedBack(this.tipPose(this.poses(q)), this.push);
    all[this.pushed] = [...mine.slice(0, 3), ...add(mine.slice(3), f)];
    return all;
  }

  // The torques that hold the robot still: gravity, springs, and the wrenches on it. MR section 8.1, dq = ddq = 0.
  holding(q, wrenches = this.wrenches(q)) {
    return this.run.holding ? this.run.holding(q, ...wrenches, ...this.load) : new Float64Array(0);
  }

  centre(q) {
    return this.run.centre ? Array.from(this.run.centre(q, ...this.load)) : null;
  }

  // What moves the tip, in the base's axes: a column (3) for each velocity. MR section 5.1.
  tipColumns(q) {
    const J = this.run.jacobian(q), n = this.robot.torques.length;
    return this.robot.torques.map((_, k) => [J[3 * n + k], J[4 * n + k], J[5 * n + k]]);
  }

  // d(entries of q)/dt, dv/dt, and the power of the wrenches, at joint torques of zero.
  motion(y) {
    const nq = this.robot.coordinates.length, nv = this.robot.torques.length;
    const q = y.subarray(0, nq), dq = y.subarray(nq, nq + nv), wrenches = this.wrenches(q), slope = new Float64Array(y.length);
    slope.set(this.run.rates(q, dq));
    slope.set(this.run.acceleration(q, dq, new Float64Array(nv), ...wrenches, ...this.load), nq);
    if (wrenches.some((F) => F !== NO_WRENCH)) {
      const with_ = this.holding(q, wrenches), without = this.holding(q, this.still); // tau = g - J' F
      for (let k = 0; k < nv; k++) slope[nq + nv] += dq[k] * (without[k] - with_[k]);
    }
    return slope;
  }
}
const poseOf = (poses, body) => (body < 0 ? IDENTITY : poses[body]);
