// The robot's mechanics: the programs that twistwrench made for it, and what is put on it by hand, a payload and a push.
"use strict";

const NO_WRENCH = [0, 0, 0, 0, 0, 0];

class Mechanics {
  constructor(robot) {
    this.robot = robot;
    this.run = PROGRAMS;
    this.mass = 0; // at the tip [kg]
    this.push = [0, 0, 0]; // on the tip, in the base's axes [N]
    this.tau = robot.torques.map(() => 0); // of the motors, while it is let go
    const [n, nv] = [16 * (robot.bodies.length + 2 * robot.frames.length + 1), robot.torques.length];
    this.scratch = { poses: new Float64Array(n), with: new Float64Array(nv), without: new Float64Array(nv), lambda: [0], pivots: [0], zero: new Float64Array(nv) };
    this.open = false; // let go with its feet off the floor
    this.still = robot.wrenchFrames.map(() => NO_WRENCH);
    const names = robot.frames.map((frame) => frame.name);
    this.given = robot.wrenchFrames.map((name) => {
      const mine = robot.wrenches.find((wrench) => names[wrench.frame] === name);
      return mine ? [...mine.moment, ...mine.force] : NO_WRENCH;
    });
    this.any = this.given.some((F) => F.some((x) => x));
  }

  choose(k) { Object.assign(this.robot, this.robot.tips[k], { chosenTip: k }); }

  get pushed() { // the tip among the frames of wrenches
    const { payload, wrenchFrames, frames, tip } = this.robot;
    return payload === null ? -1 : wrenchFrames.indexOf(frames[tip].name);
  }

  get load() { return this.carrying(this.mass); }

  carrying(mass) { // the last input of the programs that have one: what each tip carries
    const { payload, tips, chosenTip } = this.robot;
    return payload === null ? [] : [tips.length ? tips.map((_, k) => (k === chosenTip ? mass : 0)) : [mass]];
  }

  // T_s,body of every body.
  poses(q) {
    if (!this.robot.bodies.length) return [];
    const T = this.run.poses(q);
    return this.robot.bodies.map((_, k) => Array.from(T.subarray(16 * k, 16 * k + 16)));
  }

  tipPose(q) { // behind the bodies stand the frames of the wrenches
    const at = 16 * (this.robot.bodies.length + this.pushed);
    return this.run.poses(q, this.scratch.poses).slice(at, at + 16);
  }

  // The wrenches on the robot, each in its own frame: those given, and the push.
  wrenches(q) {
    if (this.pushed < 0 || !this.push.some((x) => x)) return this.given;
    const all = this.given.slice(), [a, b, c, x, y, z] = all[this.pushed], [u, v, w] = turnedBack(this.tipPose(q), this.push);
    all[this.pushed] = [a, b, c, x + u, y + v, z + w];
    return all;
  }

  // The torques that hold the robot still: gravity, springs, and the wrenches on it. MR section 8.1, dq = ddq = 0.
  holding(q, wrenches = this.wrenches(q), out = new Float64Array(this.robot.torques.length)) {
    return this.run.holding ? this.run.holding(q, ...wrenches, ...this.load, out) : out;
  }

  centre(q) {
    return this.run.centre ? Array.from(this.run.centre(q, ...this.load)) : null;
  }

  jacobian(q) { return this.run[`jacobian${this.robot.tips.length ? this.robot.chosenTip : 0}`](q); }

  // What moves the tip, in the base's axes: a column (3) for each velocity, (6) with turns times a length. MR section 5.1.
  tipColumns(q, length = 0) {
    const J = this.jacobian(q), n = this.robot.torques.length, rows = length ? [0, 1, 2, 3, 4, 5] : [3, 4, 5];
    return this.robot.torques.map((_, k) => rows.map((i) => (i < 3 ? length : 1) * J[n * i + k]));
  }

  massMatrix(q) { // by rows, what is at the tip included. MR section 8.1
    return this.run.mass(q, ...this.load);
  }

  kinetic(q, dq) { return kineticOf(this.massMatrix(q), dq); }

  accelerations(q, dq, wrenches, out) { // by the torques that are set; along a wall, with loops closed, or on the feet
    const { run, scratch, tau, robot } = this;
    if (robot.loops) return this.heldAccelerations(q, dq, wrenches, out);
    if (!run.constrained) return run.acceleration(q, dq, tau, ...wrenches, ...this.load, out);
    run.constrained(q, dq, tau, ...wrenches, ...this.load, { ddq: out, lambda: scratch.lambda, pivots: scratch.pivots });
    return out;
  }

  // M ddq + h + A'x = tau, A ddq + (dA/dt) dq = 0; x = 0 where the loops are open. MR section 8.7.
  heldAccelerations(q, dq, wrenches, out) {
    const { run, scratch, tau, open } = this, n = tau.length, h = run.inverse(q, dq, scratch.zero, ...wrenches, ...this.load, scratch.with);
    const { L, Y, R } = constrainedMass(this.massMatrix(q), n, open ? [] : byRows(run.closing_rows(q), n));
    const z = lowered(L, tau.map((x, k) => x - h[k])), bias = open ? [] : run.closing_bias(q, dq);
    const x = Y.length ? raised(R, lowered(R, Y.map((y, i) => inner(y, z) + bias[i]))) : [];
    out.set(raised(L, Y.reduce((sum, y, i) => add(sum, times(-x[i], y)), z)));
    return out;
  }

  // d(entries of q)/dt, dv/dt, and the power of the wrenches and the motors; y is q, v, and one entry more.
  motion(y, slope) {
    const nq = this.robot.coordinates.length, nv = this.robot.torques.length, { scratch } = this;
    const v = y.subarray(nq), wrenches = this.wrenches(y);
    this.run.rates(y, v, slope);
    this.accelerations(y, v, wrenches, slope.subarray(nq));
    slope[nq + nv] = 0;
    for (let k = 0; k < nv; k++) slope[nq + nv] += v[k] * this.tau[k];
    if (!this.any && wrenches === this.given) return slope;
    this.holding(y, wrenches, scratch.with); // tau = g - J' F
    this.holding(y, this.still, scratch.without);
    for (let k = 0; k < nv; k++) slope[nq + nv] += v[k] * (scratch.without[k] - scratch.with[k]);
    return slope;
  }
}
const poseOf = (poses, body) => (body < 0 ? IDENTITY : poses[body]);

const kineticOf = (M, v) => 0.5 * byRows(M, v.length).reduce((sum, row, k) => sum + v[k] * inner(row, v), 0); // ½ v' M v
const byRows = (A, n) => Array.from({ length: A.length / n }, (_, i) => Array.from(A.slice(n * i, n * (i + 1))));

// M = L L', rows of Y' = L^-1 A', and A M^-1 A' = R R'.
function constrainedMass(M, n, A) {
  const L = cholesky(M, n), Y = A.map((row) => lowered(L, row)), S = Y.flatMap((a) => Y.map((b) => inner(a, b)));
  const most = Math.max(0, ...Y.map((_, i) => S[(Y.length + 1) * i]));
  Y.forEach((_, i) => { S[(Y.length + 1) * i] += 1e-14 * most; });
  return { L, Y, R: cholesky(S, Y.length) };
}
