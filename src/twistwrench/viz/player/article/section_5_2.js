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

  push(f = this.force, tip = this.arm().tip) { return arrowOf("wrench", tip, [...times(PER_FORCE, f), 0], "f", { width: 5 }); }

  arcs({ elbow, tau }, labels = ["τ₁", "τ₂"]) {
    return [ORIGIN, elbow].flatMap((middle, k) => turnArc(middle, PER_TORQUE * tau[k], "wrench", labels[k]));
  }

  // Line of a force, and the levers from the joints to it.
  levers({ elbow, tip, force }) { return leversTo([ORIGIN, elbow], tip, unit([...force, 0])); }

  scene() { const now = this.arm(); return [...this.levers(now), ...this.body(), ...this.arcs(now), this.push()]; }

  numbers() {
    const { tau } = this.state();
    return tau.map((x, k) => [`τ${"₁₂"[k]}`, decimal(x, 3), "N m", "wrench"]);
  }
}

// A wall or ceiling on the far side of a place that is pushed or pulled at, with what is behind it hatched. along: unit vector of the wall.
function wallAt(p, along, half = 0.32) {
  const back = [along[1], -along[0], 0], at = (s, depth) => add(p, add(times(s, along), times(depth, back))), line = (points, width) => ({ kind: "floor", name: "edge", width, points });
  return [line([at(-half, 0), at(half, 0)], 4), ...Array.from({ length: 9 }, (_, k) => half * (k / 4 - 1)).map((s) => line([at(s, 0), at(s - 0.06, 0.07)], 1.5))];
}

const stringFrom = (p, way) => ({ kind: "floor", name: "edge", width: 2, points: [p, add(p, way)] });

class Lever extends Arm {
  get angles() { return [radiansOf(this.values.shoulder), BEND]; }
  scene() { return [...wallAt(add(this.arm().tip, [-0.06, 0, 0]), [0, -1, 0]), ...super.scene()]; }

  numbers() {
    const { tip, elbow, tau } = this.state();
    return [["levers", `${decimal(tip[1], 3)}, ${decimal(tip[1] - elbow[1], 3)}`, "m", "change"], ["τ₁", decimal(tau[0], 3), "N m", "wrench"], ["τ₂", decimal(tau[1], 3), "N m", "wrench"]];
  }

  truth() { return this.arm([SHOULDER, BEND]).tau[0]; }

  question() { // τ₁ at 30°, 60° of 10 N along −x
    const { tau, tip } = this.arm([SHOULDER, BEND]), y = (one) => STRENGTH * (Math.sin(30) + one);
    const inTip = -STRENGTH * tip[0]; // f in the axes of the tip, and also the second component of J f
    return { answer: tau[0], other: { frame: [inTip, -inTip], degrees: [y(1), y(Math.sin(90))] } };
  }
}

class Along extends Arm {
  get force() { return [0, -this.values.load]; }
  truth() { return 2; } // joint 2, the second choice

  scene() { // a string from the ceiling
    const { tip } = this.arm(), up = [0, 0.27, 0];
    return [...wallAt(add(tip, up), [-1, 0, 0]), stringFrom(tip, up), ...super.scene()];
  }
}

class Turned extends Arm {
  get force() { const angle = radiansOf(this.values.angle); return [STRENGTH * Math.cos(angle), STRENGTH * Math.sin(angle)]; }

  scene() { // beside the arm, both torques over the angle
    const at = (degrees, tau) => [1.5 + degrees / 260, 0.75 + 0.045 * tau, 0], count = 72;
    const curve = (k) => Array.from({ length: count + 1 }, (_, i) => {
      const degrees = (360 * i) / count, angle = radiansOf(degrees);
      return at(degrees, this.arm(this.angles, [STRENGTH * Math.cos(angle), STRENGTH * Math.sin(angle)]).tau[k]);
    });
    const now = this.arm(), marks = now.tau.map((tau, k) => ({ kind: "dot", name: ["wrench", "axes"][k], at: at(this.values.angle, tau), label: `τ${"₁₂"[k]}` }));
    const rule = (from, to, name) => ({ kind: "floor", name, width: 1, points: [at(...from), at(...to)] });
    const scale = [-20, -10, 0, 10, 20].flatMap((tau) => [rule([0, tau], [360, tau], tau ? "floor" : "line"), { kind: "note", at: at(-26, tau), label: decimal(tau, 0) }]);
    const angles = [90, 180, 270, 360].flatMap((degrees) => [rule([degrees, -20], [degrees, 20], "floor"), { kind: "note", at: at(degrees, -23.5), label: degrees % 180 ? "" : `${degrees}°` }]);
    return [...scale, ...angles, rule([0, -20], [0, 20], "line"), { kind: "note", at: at(0, 23.5), label: "N m" }, { kind: "line", name: "wrench", width: 2.5, points: curve(0) }, { kind: "line", name: "axes", width: 2.5, points: curve(1) }, ...this.body(), ...this.arcs(now), this.push(), ...marks];
  }

  numbers() { // rows of the transposed Jacobian: levers of a force along x, and along y
    const { J, tau } = this.state();
    return [...tau.map((x, k) => [`τ${"₁₂"[k]}`, decimal(x, 3), "N m", "wrench"]), ...tau.map((_, k) => [`row ${k + 1} of Jᵀ`, vectorText([J[0][k], J[1][k]], 3), "m", "change"])];
  }
}

const WIDE = 1.6; // m of a rectangle for a metre or a radian

class Work extends Arm {
  state() {
    const { J, force, tau, ...rest } = this.arm(), { turn: d } = this.values, way = [J[0][0] * d, J[1][0] * d];
    return { t: this.t, ...rest, J, force, tau, way, turn: d, work_force: force[0] * way[0] + force[1] * way[1], work_torque: tau[0] * d };
  }

  scene() {
    const { tip, way, tau, turn: d } = this.state(), [a, b] = this.angles, moved = this.body([a + d, b]).filter(({ kind }) => kind === "solid");
    const area = (x, y, width, height) => ({ kind: "area", name: "wrench", corners: [[x, y, 0], [x + width, y, 0], [x + width, y + height, 0], [x, y + height, 0]] });
    const [along, scale] = [-way[0], 0.045];
    return [
      ...moved, ...this.body(), this.push(), arrowOf("twist", tip, [...way, 0], "δx", { width: 4 }), ...this.arcs({ ...this.arm(), tau: [tau[0], 0] }),
      area(1.35, 0.3, WIDE * along, STRENGTH * scale), { kind: "dot", name: "line", at: [1.35, 0.3, 0], label: "f δx", below: true }, area(2.2, 0.3, WIDE * d, tau[0] * scale), { kind: "dot", name: "line", at: [2.2, 0.3, 0], label: "τ δθ", below: true },
    ];
  }

  numbers() {
    const { way, work_force, work_torque, tau, turn: d } = this.state();
    return [["force × way", `${decimal(STRENGTH, 0)} × ${decimal(-way[0], 3)} = ${decimal(work_force, 3)}`, "J", "wrench"], ["torque × angle", `${decimal(tau[0], 0)} × ${decimal(d, 3)} = ${decimal(work_torque, 3)}`, "J", "wrench"]];
  }
}

const PULLED = 0.1; // m/s, of the tip towards the shoulder

class Straight extends Arm {
  get angles() { const bend = radiansOf(this.values.bend); return [SHOULDER + BEND / 2 - bend / 2, bend]; }
  get force() { const [a, b] = this.angles, angle = a + b / 2; return [-STRENGTH * Math.cos(angle), -STRENGTH * Math.sin(angle)]; }
  scene() { const { tip, force } = this.arm(); return [stringFrom(tip, times(-1 / STRENGTH, [...force, 0])), ...super.scene()]; }

  state() {
    const now = super.state(), lever = LINK * Math.sin(radiansOf(this.values.bend) / 2);
    return { ...now, elbow_rate: lever > 0 ? PULLED / lever : null };
  }

  numbers() {
    const { tau, elbow_rate } = this.state();
    return [["τ₁", decimal(tau[0], 3), "N m", "wrench"], ["τ₂", decimal(tau[1], 3), "N m", "wrench"], ["elbow for 0.1 m/s", elbow_rate === null ? "no speed suffices" : decimal(elbow_rate, 2), elbow_rate === null ? "" : "rad/s", "twist"]];
  }
}

const inverseTransposed = ([[a, b], [c, d]], [x, y]) => { const D = a * d - b * c; return [(d * x - c * y) / D, (a * y - b * x) / D]; }; // J⁻ᵀ τ

class Ellipse extends Arm {
  get tau() { const angle = radiansOf(this.values.angle); return [STRENGTH * Math.cos(angle), STRENGTH * Math.sin(angle)]; }
  get force() { return inverseTransposed(this.arm(this.angles, [0, 0]).J, this.tau); }

  scene() {
    const { J, tip } = this.arm(this.angles, [0, 0]), middle = [2.1, 0.75, 0], ring = Array.from({ length: 73 }, (_, k) => (Math.PI * k) / 36);
    const at = (tau) => add(middle, [...times(0.05, tau), 0]), end = (tau) => add(tip, [...times(0.022, inverseTransposed(J, tau)), 0]), of = (angle) => [STRENGTH * Math.cos(angle), STRENGTH * Math.sin(angle)];
    return [
      ...this.body(), { kind: "line", name: "wrench", width: 2.5, points: ring.map((angle) => end(of(angle))) }, { kind: "line", name: "axes", width: 2, points: ring.map((angle) => at(of(angle))) },
      arrowOf("axes", middle, add(at(this.tau), times(-1, middle)), "τ", { width: 3 }), arrowOf("wrench", tip, add(end(this.tau), times(-1, tip)), "f", { width: 4 }), { kind: "dot", at: middle, name: "axes", label: "" },
    ];
  }

  numbers() {
    const { force, tau } = this.state();
    return [["τ", vectorText(tau, 2), "N m", "line"], ["f", vectorText(force, 2), "N", "wrench"], ["|f|", decimal(Math.hypot(...force), 2), "N", "wrench"]];
  }
}

const PICTURES = { push: Lever, along: Along, turned: Turned, work: Work, straight: Straight, ellipse: Ellipse };
