// A robot let go: its motion under gravity, springs, wrenches and constant torques, without friction, stops or contact.
"use strict";

const LONGEST_FRAME = 8; // ms of computing a frame; a robot that takes longer falls slower than the clock

class Fall {
  constructor(mechanics, q, dq = []) {
    const { fall, coordinates, torques } = mechanics.robot;
    Object.assign(this, { mechanics, h: fall.step, a: fall.a, b: fall.b, nq: coordinates.length, nv: torques.length });
    this.y = new Float64Array(this.nq + this.nv + 1); // q, dq, and the work of wrenches and motors
    this.y.set(q);
    this.y.set(dq, this.nq);
    this.z = this.y.slice();
    this.k = fall.b.map(() => this.y.slice());
    this.time = 0;
    this.behind = 0; // of the clock [s]
    this.spent = 0; // on computing the last frame [ms]
    this.reckon();
  }

  get q() { return Array.from(this.y.subarray(0, this.nq)); }
  get dq() { return Array.from(this.y.subarray(this.nq, this.nq + this.nv)); }
  get kinetic() { return this.mechanics.run.kinetic(this.y, this.y.subarray(this.nq), ...this.mechanics.load)[0]; }
  get potential() { return this.mechanics.run.potential(this.y, ...this.mechanics.load)[0]; }
  get work() { return this.y[this.nq + this.nv]; }

  reckon() { // anew from here: after a change of what is on the robot its energy is another
    this.begin = this.kinetic + this.potential - this.work;
    this.drift = 0; // the largest so far [J]
  }

  step() { // Runge-Kutta: k_i = f(y + h sum a_ij k_j), y + h sum b_i k_i
    const { y, z, k, h, a, b, mechanics } = this;
    const along = (weights) => {
      z.set(y);
      weights.forEach((w, j) => { if (w) for (let i = 0; i < z.length; i++) z[i] += h * w * k[j][i]; });
      return z;
    };
    a.forEach((row, j) => mechanics.motion(along(row), k[j]));
    y.set(along(b));
    this.time += h;
  }

  // On by so many seconds of the clock.
  advance(seconds) {
    const begun = performance.now();
    this.behind += seconds;
    for (let k = 0; this.behind >= this.h; k++) {
      this.step();
      this.behind -= this.h;
      if (k % 16 === 15 && performance.now() - begun > LONGEST_FRAME) this.behind = 0;
    }
    this.drift = Math.max(this.drift, Math.abs(this.kinetic + this.potential - this.work - this.begin));
    this.spent = performance.now() - begun;
  }
}
