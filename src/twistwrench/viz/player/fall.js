// A robot let go: its motion under gravity, springs, wrenches and constant torques, with its loops closed or its feet held where
// they are, above a solid floor or none; with stops and friction, or without them and with an account of its energy.
"use strict";

const LONGEST_FRAME = 8; // ms of computing a frame; a robot that takes longer falls slower than the clock
const PACE_OVER = 1; // s
const STILL = { share: 1e-6, speed: 2e-3, seconds: 0.5 }; // of the largest kinetic energy; rad/s, m/s

class Fall {
  constructor(mechanics, q, dq = [], stops = false, loops = null, floor = null) {
    const { fall, coordinates, torques } = mechanics.robot;
    Object.assign(this, { mechanics, loops, floor, h: stops ? fall.coarse : fall.step, a: fall.a, b: fall.b, nq: coordinates.length, nv: torques.length });
    this.resistance = stops ? new Resistance(fall, torques.length) : null;
    const none = torques.map(() => 0);
    this.free = floor && !stops ? new Resistance({ viscous: none, coulomb: none, stops: [] }, torques.length) : null;
    this.y = new Float64Array(this.nq + this.nv + 1); // q, dq, and the work of wrenches and motors
    this.y.set(q);
    this.y.set(dq, this.nq);
    this.z = this.y.slice();
    this.k = fall.b.map(() => this.y.slice());
    Object.assign(this, { forces: [], base: mechanics.tau.slice(), asked: 0, done: 0 }); // functions of (q, dq) that give torques beside the base's; s of the clock and of the fall
    this.time = 0;
    this.behind = 0; // of the clock [s]
    this.spent = 0; // on computing the last frame [ms]
    this.reckon();
  }

  get q() { return Array.from(this.y.subarray(0, this.nq)); }
  get dq() { return Array.from(this.y.subarray(this.nq, this.nq + this.nv)); }
  get kinetic() { return this.mechanics.kinetic(this.y, this.dq); }
  get potential() { return this.mechanics.run.potential(this.y, ...this.mechanics.load)[0]; }
  get work() { return this.y[this.nq + this.nv]; }

  reckon() { // anew from here: after a change of what is on the robot its energy is another
    this.begin = this.kinetic + this.potential - this.work;
    Object.assign(this, { drift: 0, lost: 0, most: 0, calm: 0 }); // largest drift so far, given to the floor, largest kinetic energy [J]
  }

  step() { // Runge-Kutta: k_i = f(y + h sum a_ij k_j), y + h sum b_i k_i
    const { y, z, k, h, a, b, mechanics } = this;
    const along = (weights) => {
      z.set(y);
      weights.forEach((w, j) => { if (w) for (let i = 0; i < z.length; i++) z[i] += h * w * k[j][i]; });
      return z;
    };
    if (this.forces.length) mechanics.tau = this.forces.reduce((sum, torques) => add(sum, torques(this.q, this.dq)), this.base);
    a.forEach((row, j) => mechanics.motion(along(row), k[j]));
    const first = this.dq;
    y.set(along(b));
    this.time += h;
    this.impulses(times(0.5, add(first, this.dq)));
  }

  impulses(mean) { // of friction, stops and floor; with the mean velocity of the step
    const { y, nq, nv, h, mechanics, loops, floor, resistance } = this, contacts = floor ? floor.contacts(y.subarray(0, nq), nv) : [];
    if (!resistance && !contacts.length) return;
    const M = mechanics.massMatrix(y), before = kineticOf(M, this.dq), W = mobility(M, nv, loops ? loops.jacobian(y) : []), conditions = floor ? floor.conditions(contacts, W, h) : [];
    (resistance ?? this.free).slow(y, nq, W, h, !loops, conditions);
    floor?.keep(conditions);
    const v = this.dq, kinetic = kineticOf(M, v), stands = (w) => kineticOf(M, w) <= STILL.share * this.most && w.every((x) => Math.abs(x) < STILL.speed);
    if (!resistance) this.lost += before - kinetic;
    this.most = Math.max(this.most, kinetic);
    this.calm = stands(v) || stands(mean) ? this.calm + h : 0; // what the floor bears has a velocity at the end of a step, and none in the mean
  }

  keep() { // loops as closed as they were, which the steps leave by their error; what is at its stop stays there
    const { y, nq, nv, loops, resistance } = this, every = new Array(nv).fill(true);
    const q = loops.closed(this.q, every.map((_, k) => !resistance?.at[k])) ?? loops.closed(this.q, every) ?? this.q;
    const rows = loops.jacobian(q), v = this.dq, off = rows.map((row) => inner(row, v));
    y.set(q);
    dampedStep(v.map((_, k) => rows.map((row) => row[k])), off, 1e-13).forEach((x, k) => { y[nq + k] -= x; });
  }

  get rests() { return this.calm > STILL.seconds; }

  // On by so many seconds of the clock.
  advance(seconds) {
    const begun = performance.now(), from = this.time;
    this.behind += seconds;
    if (this.rests) this.behind = 0;
    for (let k = 0; this.behind >= this.h; k++) {
      this.step();
      this.behind -= this.h;
      if (k % 4 === 3 && performance.now() - begun > LONGEST_FRAME) this.behind = 0;
    }
    if (this.loops) this.keep();
    this.drift = Math.max(this.drift, Math.abs(this.kinetic + this.potential - this.work + this.lost - this.begin));
    this.spent = performance.now() - begun;
    const keep = Math.exp(-seconds / PACE_OVER);
    Object.assign(this, { asked: keep * this.asked + seconds, done: keep * this.done + this.time - from });
  }

  get pace() { return this.asked ? this.done / this.asked : 1; } // times real time, over the last second or so
}

// Friction and stops of joints, as impulses p of one time step: v = v* + M^-1 p, where v* is without them. Viscous friction is
// -h b v, Coulomb friction up to h c against v, and at a stop p pushes back as far as v needs to be zero. By sweeps over the
// joints from the impulses of the last step (projected Gauss-Seidel).
class Resistance {
  constructor({ viscous, coulomb, stops }, n) {
    Object.assign(this, { viscous, coulomb, stops, n, p: new Float64Array(n), inverse: [] });
    this.at = new Array(n).fill(0); // the stop that a joint is at: -1 the lower, 1 the upper
  }

  slow(y, nq, W, h, halts, floor = []) { // W = M^-1; where loops are closed, of what moves along them, and joints at stops are put back later
    const { n, p, stops, viscous, coulomb } = this, v = y.subarray(nq, nq + n);
    stops.forEach((stop, k) => { this.at[k] = !stop ? 0 : y[stop.q] <= stop.least ? -1 : y[stop.q] >= stop.most ? 1 : 0; });
    for (let k = 0; k < n; k++) for (let i = 0; i < n; i++) v[i] += W[k][i] * p[k];
    for (const { along, p: push } of floor) for (let i = 0; i < n; i++) v[i] += along[i] * push;
    for (let sweep = 0; sweep < 60; sweep++) {
      let change = 0;
      for (let k = 0; k < n; k++) {
        if (!(W[k][k] > 1e-12)) continue;
        const w = W[k][k], free = v[k] - w * p[k], dry = w * h * coulomb[k];
        let after = Math.abs(free) <= dry ? 0 : (free - Math.sign(free) * dry) / (1 + w * h * viscous[k]);
        if (this.at[k] && after * this.at[k] > 0) after = 0;
        const more = (after - free) / w - p[k];
        p[k] += more;
        for (let i = 0; i < n; i++) v[i] += W[k][i] * more;
        change = Math.max(change, Math.abs(w * more));
      }
      for (const contact of floor) {
        const { row, along, mobile, bias, soft } = contact, push = Math.max(0, contact.p - (inner(row, v) + bias + soft * contact.p) / (mobile + soft)), more = push - contact.p;
        contact.p = push;
        for (let i = 0; i < n; i++) v[i] += along[i] * more;
        change = Math.max(change, Math.abs(mobile * more));
      }
      if (change < 1e-8) break;
    }
    if (halts) stops.forEach((stop, k) => { if (this.at[k]) y[stop.q] = this.at[k] < 0 ? stop.least : stop.most; });
  }
}

// By rows, what takes impulses to velocities that keep A v = 0: M^-1 - M^-1 A' (A M^-1 A')^-1 A M^-1. MR section 8.7.
function mobility(M, n, A) {
  const { L, Y, R } = constrainedMass(M, n, A), units = Array.from({ length: n }, (_, k) => lowered(L, Array.from({ length: n }, (__, i) => Number(i === k))));
  const Z = units.map((u) => lowered(R, Y.map((y) => inner(y, u))));
  return units.map((u, i) => units.map((w, j) => inner(u, w) - inner(Z[i], Z[j])));
}
