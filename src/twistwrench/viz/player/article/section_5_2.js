// Section 5.2: torques of a planar arm with two links of 1 m whose tip pushes with a force, τ = Jᵀ f. In the plane x, y.
"use strict";

const PER_FORCE = 0.06, PER_TORQUE = 0.16; // m/N; rad of an arc for a N m
const SHOULDER = radiansOf(30), BEND = radiansOf(60), STRENGTH = 10; // N

class Arm extends Picture {
  get angles() { return [SHOULDER, BEND]; }
  get force() { return [-STRENGTH, 0]; }

  // Joints, tip, Jacobian by rows, and torques of a force at the tip.
  arm(angles = this.angles, f = this.force) {
    const { elbow, fore, tip } = placesOf(angles);
    const J = [[-tip[1], -fore[1]], [tip[0], fore[0]]];
    return { elbow, tip, J, force: f, tau: [0, 1].map((k) => J[0][k] * f[0] + J[1][k] * f[1]) };
  }

  state() { return { t: this.t, angles: this.angles, ...this.arm() }; }

  // Links and joints.
  body(angles = this.angles) { return [...armBody(angles), { kind: "dot", at: placesOf(angles).tip, name: "edge", label: "" }]; }

  push(f = this.force, tip = this.arm().tip) { return arrowOf("wrench", tip, [...times(PER_FORCE, f), 0], "f", { width: 5, beside: -1 }); }

  arcs({ elbow, tau }, labels = ["τ₁", "τ₂"]) {
    return [ORIGIN, elbow].flatMap((middle, k) => turnArc(middle, PER_TORQUE * tau[k], "wrench", labels[k]));
  }

  // Line of a force, and the levers from the joints to it.
  levers({ elbow, tip, force }, reach, shifts = []) { return leversTo([ORIGIN, elbow], tip, unit([...force, 0]), reach, { letters: ["r₁", "r₂"], shifts }); }

  scene() { const now = this.arm(); return [...this.levers(now), ...this.body(), ...this.arcs(now), this.push()]; }

  numbers() {
    const { tau } = this.state();
    return tau.map((x, k) => [`τ${"₁₂"[k]}`, decimal(x, 3), "N m", "wrench"]);
  }
}

// A wall or ceiling on the far side of a place that is pushed or pulled at, with what is behind it hatched. along: unit vector of the wall.
function wallAt(p, along, first = -0.22, last = 0.22) {
  const back = [along[1], -along[0], 0], at = (s, depth) => add(p, add(times(s, along), times(depth, back))), line = (points, width) => ({ kind: "floor", name: "edge", width, points });
  return [line([at(first, 0), at(last, 0)], 4), ...Array.from({ length: 7 }, (_, k) => first + ((last - first) * k) / 6).map((s) => line([at(s, 0), at(s - 0.06, 0.07)], 1.5))];
}

const BESIDE_LINK = 0.13; // m, of a lever from a link along which it lies
const stringFrom = (p, way) => ({ kind: "floor", name: "edge", width: 2, points: [p, add(p, way)] });

class Lever extends Arm {
  get angles() { return [radiansOf(this.values.shoulder), BEND]; }
  handle(shoulder) { return placesOf([radiansOf(shoulder), BEND]).elbow; }
  levers(now) { return super.levers(now, undefined, [0, BESIDE_LINK]); }
  scene() { return [...wallAt(add(this.arm().tip, [-0.06, 0, 0]), [0, -1, 0], -0.3, 0.02), ...super.scene()]; }

  numbers() {
    const { tip, elbow, tau } = this.state();
    return [["r₁", decimal(tip[1], 3), "m", "change"], ["r₂", decimal(tip[1] - elbow[1], 3), "m", "change"], ["τ₁", decimal(tau[0], 3), "N m", "wrench"], ["τ₂", decimal(tau[1], 3), "N m", "wrench"]];
  }

  truth() { return this.arm([SHOULDER, BEND]).tau[0]; }

  question() { // τ₁ at 20°, 30° of 25 N along −x
    const { tau, tip, J } = this.arm([20, 30].map(radiansOf), [-25, 0]), [c, s] = [Math.cos, Math.sin].map((of) => of(radiansOf(50)));
    const inTip = -25 * (J[0][0] * c + J[1][0] * s); // f in the axes of the tip
    return {
      answer: tau[0],
      other: { frame: [inTip, -inTip, 25 * tip[0], -25 * tip[0]], degrees: [25 * (Math.sin(20) + Math.sin(50))], named: [[tau[1], "That is joint 2's torque, and joint 1's was asked."]] }, // J f is 25 x in its second component
    };
  }
}

class Along extends Arm {
  get force() { return [0, -this.values.load]; }
  truth() { return 2; } // joint 2, the second choice
  handle(load) { return add(this.arm().tip, [0, -PER_FORCE * load, 0]); }
  levers(now) { return super.levers(now, [0, 2.6]); }

  scene() { // a string from the ceiling
    const { tip } = this.arm(), up = [0, 0.27, 0];
    return [...wallAt(add(tip, up), [-1, 0, 0]), stringFrom(tip, up), ...super.scene()];
  }
}

class Turned extends Arm {
  get force() { return this.towards(this.values.angle); }
  towards(degrees) { return [Math.cos, Math.sin].map((of) => STRENGTH * of(radiansOf(degrees))); }
  handle(angle) { return add(this.arm().tip, [...times(PER_FORCE, this.towards(angle)), 0]); }

  scene() { // beside the arm, both torques over the angle
    const at = (degrees, tau) => [2.05 + degrees / 260, 0.8 + 0.045 * tau, 0], count = 72;
    const curve = (k) => Array.from({ length: count + 1 }, (_, i) => {
      const degrees = (360 * i) / count;
      return at(degrees, this.arm(this.angles, this.towards(degrees)).tau[k]);
    });
    const now = this.arm(), marks = now.tau.map((tau) => ({ kind: "dot", name: "wrench", at: at(this.values.angle, tau) }));
    const curves = [0, 1].flatMap((k) => [{ kind: "line", name: "wrench", width: 2.5, dashed: k === 1, points: curve(k) }, { kind: "note", name: "wrench", at: add(curve(k)[count], [0.12, 0, 0]), label: `τ${"₁₂"[k]}` }]);
    const corner = [-0.5, 1.35, 0], ways = [[0.26, 0, 0], [0, 0.26, 0]].map((way, k) => arrowOf("axes", corner, way, "xy"[k], { width: 2 }));
    const rule = (from, to, name) => ({ kind: "floor", name, width: 1, points: [at(...from), at(...to)] });
    const scale = [-20, -10, 0, 10, 20].flatMap((tau) => [rule([0, tau], [360, tau], tau ? "floor" : "line"), { kind: "note", at: at(-26, tau), label: decimal(tau, 0) }]);
    const angles = [0, 90, 180, 270, 360].flatMap((degrees) => [rule([degrees, -20], [degrees, 20], "floor"), { kind: "note", at: at(degrees, -23.5), label: degrees % 180 ? "" : `${degrees}°` }]);
    return [...scale, ...angles, rule([0, -20], [0, 20], "line"), { kind: "note", at: at(0, 23.5), label: "N m" }, ...curves, ...ways, ...this.body(), ...this.arcs(now), this.push(), ...marks];
  }

  numbers() { // rows of the transposed Jacobian: levers of a force along x, and along y
    const { J, tau } = this.state();
    return [...tau.map((x, k) => [`τ${"₁₂"[k]}`, decimal(x, 3), "N m", "wrench"]), ...tau.map((_, k) => [`row ${k + 1} of Jᵀ`, vectorText([J[0][k], J[1][k]], 3), "m", "change"])];
  }
}

const WIDE = 2.2, HIGH = 0.045; // m of a rectangle for a metre or a radian; for a N or N m

class Work extends Arm {
  handle(turn) { return placesOf([SHOULDER + turn, BEND]).tip; }

  state() {
    const { J, force, tau, ...rest } = this.arm(), { turn: d } = this.values, way = [J[0][0] * d, J[1][0] * d];
    return { t: this.t, ...rest, J, force, tau, way, turn: d, work_force: force[0] * way[0] + force[1] * way[1], work_torque: tau[0] * d };
  }

  scene() {
    const { tip, way, tau, turn: d } = this.state(), [a, b] = this.angles, moved = this.body([a + d, b]).filter(({ kind }) => kind === "solid");
    const area = (x, width, height, across, up) => {
      const y = 0.25, corner = [x, y, 0], long = times(WIDE * width, [1, 0, 0]), high = times(HIGH * height, [0, 1, 0]), letter = (at, label, name) => ({ kind: "note", name, at, label });
      return [
        { kind: "area", name: "wrench", corners: [corner, add(corner, long), add(corner, add(long, high)), add(corner, high)] }, { kind: "floor", name: "line", width: 1.5, points: [[x, y + 0.85, 0], corner, [x + 1.05, y, 0]] },
        letter([x - 0.13, y + HIGH * height * 0.5, 0], up, "wrench"), letter([x + 0.4, y - 0.16, 0], across, "twist"),
      ];
    };
    return [
      ...moved, ...this.body(), this.push(), arrowOf("twist", tip, [...way, 0], "δx", { width: 4 }), ...this.arcs({ ...this.arm(), tau: [tau[0], 0] }),
      ...area(1.5, -way[0], STRENGTH, "way", "f"), ...area(2.85, d, tau[0], "δθ", "τ₁"),
    ];
  }

  numbers() {
    const { way, work_force, work_torque, tau, turn: d } = this.state();
    return [["force × way", `${decimal(STRENGTH, 0)} × ${decimal(-way[0], 3)} = ${decimal(work_force, 3)}`, "J", "wrench"], ["torque × angle", `${decimal(tau[0], 0)} × ${decimal(d, 3)} = ${decimal(work_torque, 3)}`, "J", "wrench"]];
  }
}

const PULLED = 0.1; // m/s, of the tip towards the shoulder

class Straight extends Arm {
  get angles() { return this.bent(this.values.bend); }
  bent(degrees) { const bend = radiansOf(degrees); return [SHOULDER + BEND / 2 - bend / 2, bend]; }
  handle(bend) { return placesOf(this.bent(bend)).elbow; }
  levers(now) { return super.levers(now, [0, 2.6]); }
  get force() { const [a, b] = this.angles, angle = a + b / 2; return [-STRENGTH * Math.cos(angle), -STRENGTH * Math.sin(angle)]; }

  scene() { // a string to a wall
    const { tip, force } = this.arm(), [x, y] = times(-1 / STRENGTH, force), string = times(0.2, [x, y, 0]);
    return [...wallAt(add(tip, string), [-y, x, 0], -0.15, 0.15), stringFrom(tip, string), ...super.scene()];
  }

  state() {
    const now = super.state(), lever = LINK * Math.sin(radiansOf(this.values.bend) / 2);
    return { ...now, elbow_rate: lever > 0 ? PULLED / lever : null };
  }

  numbers() {
    const { tau, elbow_rate } = this.state();
    return [["τ₁", decimal(tau[0], 3), "N m", "wrench"], ["τ₂", decimal(tau[1], 3), "N m", "wrench"], ["elbow for 0.1 m/s", elbow_rate === null ? "impossible" : decimal(elbow_rate, 2), elbow_rate === null ? "" : "rad/s", "twist"]];
  }
}

const inverseTransposed = ([[a, b], [c, d]], [x, y]) => { const D = a * d - b * c; return [(d * x - c * y) / D, (a * y - b * x) / D]; }; // J⁻ᵀ τ

const TORQUES = [2.3, 0.75, 0]; // middle of their circle

class Ellipse extends Arm {
  get tau() { return this.of(radiansOf(this.values.angle)); }
  of(angle) { return [STRENGTH * Math.cos(angle), STRENGTH * Math.sin(angle)]; }
  handle(angle) { return this.onCircle(this.of(radiansOf(angle))); }
  onCircle(tau) { return add(TORQUES, [...times(0.05, tau), 0]); }
  get force() { return inverseTransposed(this.arm(this.angles, [0, 0]).J, this.tau); }

  scene() {
    const { J, tip } = this.arm(this.angles, [0, 0]), middle = TORQUES, ring = Array.from({ length: 73 }, (_, k) => (Math.PI * k) / 36);
    const at = (tau) => this.onCircle(tau), end = (tau) => add(tip, [...times(0.022, inverseTransposed(J, tau)), 0]);
    const rule = (points) => ({ kind: "floor", name: "line", width: 1.5, points }), note = (at, label, name = "line") => ({ kind: "note", name, at, label }), bar = [-0.35, 1.3, 0];
    return [
      rule([at([-14, 0]), at([14, 0])]), rule([at([0, -14]), at([0, 14])]), note(at([16, 0]), "τ₁", "wrench"), note(at([0, 16]), "τ₂", "wrench"), note(at([-9.5, 10.5]), "10 N m"),
      rule([bar, add(bar, [20 * 0.022, 0, 0])]), note(add(bar, [0.22, 0.11, 0]), "20 N"),
      ...this.body(), { kind: "line", name: "wrench", width: 2.5, points: ring.map((angle) => end(this.of(angle))) }, { kind: "line", name: "wrench", width: 2, points: ring.map((angle) => at(this.of(angle))) },
      arrowOf("wrench", middle, add(at(this.tau), times(-1, middle)), "τ", { width: 4 }), arrowOf("wrench", tip, add(end(this.tau), times(-1, tip)), "f", { width: 4 }), { kind: "dot", at: middle, name: "axes", label: "" },
    ];
  }

  numbers() {
    const { force, tau } = this.state();
    return [["τ", vectorText(tau, 2), "N m", "wrench"], ["f", vectorText(force, 2), "N", "wrench"], ["|f|", decimal(Math.hypot(...force), 2), "N", "wrench"]];
  }
}

const PICTURES = { push: Lever, along: Along, turned: Turned, work: Work, straight: Straight, ellipse: Ellipse };
