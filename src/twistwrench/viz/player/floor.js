// A solid floor under a robot let go: a one-sided spring below each sphere around a link, and below the tip.
"use strict";

const SPRING = 2 * Math.PI * 100; // rad/s, with the mass that moves at a contact
const RATIO = 0.7; // of damping
const SUNK = 2e-3; // of the robot's size, under its whole weight
const NUDGE = 1e-6; // rad, m: by which a coordinate is changed for the slope of a height

class Floor {
  constructor(mechanics, height, q) {
    const { fall, frames, tip, moving, size } = mechanics.robot, end = tip === null ? [] : [{ body: frames[tip].body, middle: place(frames[tip].pose), radius: 0 }];
    Object.assign(this, { mechanics, height, spheres: [...fall.spheres, ...end].filter(({ body }) => body >= 0), pushes: new Map() });
    this.stiffness = (9.81 * moving) / (SUNK * size); // N/m, at least
    this.below = this.heights(q).map((z) => Math.min(0, z)); // what begins below the floor is not lifted
  }

  heights(q) { // of the lowest points of the spheres above the floor
    const T = this.mechanics.run.poses(q, this.mechanics.scratch.poses);
    return this.spheres.map(({ body, middle: [x, y, z], radius }) => T[16 * body + 8] * x + T[16 * body + 9] * y + T[16 * body + 10] * z + T[16 * body + 11] - radius - this.height);
  }

  // Spheres in the floor: how deep, and the rate of their height for each velocity.
  contacts(q, nv) {
    const heights = this.heights(q), touching = heights.flatMap((z, i) => (z < this.below[i] ? [i] : []));
    if (!touching.length) { this.pushes.clear(); return []; }
    const rows = touching.map(() => new Float64Array(nv)), moved = Float64Array.from(q), v = new Float64Array(nv);
    for (let k = 0; k < nv; k++) {
      v.fill(0);
      v[k] = 1;
      const rates = this.mechanics.run.rates(q, v);
      for (let i = 0; i < moved.length; i++) moved[i] = q[i] + NUDGE * rates[i];
      const after = this.heights(moved);
      touching.forEach((i, c) => { rows[c][k] = (after[i] - heights[i]) / NUDGE; });
    }
    return touching.map((i, c) => ({ i, row: rows[c], depth: this.below[i] - heights[i] }));
  }

  // The same as conditions on the impulses p >= 0 of a step: row v + bias + soft p = 0, which is a spring and a damper at its end.
  conditions(contacts, W, h) {
    return contacts.flatMap(({ i, row, depth }) => {
      const along = W.map((w) => inner(w, row)), mobile = inner(along, row);
      if (!(mobile > 1e-9)) return [];
      const k = Math.max(SPRING ** 2 / mobile, this.stiffness), d = 2 * RATIO * Math.sqrt(k / mobile);
      return [{ i, row, along, mobile, bias: (-depth * k) / (d + h * k), soft: 1 / (h * (d + h * k)), p: this.pushes.get(i) ?? 0 }];
    });
  }

  keep(conditions) { this.pushes = new Map(conditions.map(({ i, p }) => [i, p])); }
}
