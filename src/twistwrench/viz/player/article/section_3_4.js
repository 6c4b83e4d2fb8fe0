// Section 3.4: one push, in the numbers of several frames. In the plane x, y a wrench is (m, f_x, f_y).
"use strict";

const HERE = [0, 0, 0], GRAVITY = 10; // m/s², as in the book's example 3.28
const HAND = { mass: 0.5, at: 0.1 }, APPLE = { mass: 0.1, beyond: 0.15 }; // kg, m from the sensor; kg, m from the hand
const PER_NEWTON = 0.034;

// Wrench of a force that acts at a point, about the origin of a frame with orientation R at p, in its axes. (3.98)
const wrenchOf = (force, at, R = UPRIGHT, p = HERE) => [...rotatedBack(R, cross(add(at, times(-1, p)), force)), ...rotatedBack(R, force)];
const planar = ([, , m, x, y]) => [m, x, y];
const planarText = (F, decimals = 2) => vectorText(planar(F), decimals);

class Held extends Picture { // an apple in a hand on a sensor
  at(beyond = this.values.beyond) { // both weights, and their wrench
    const weights = [[HAND.mass, HAND.at], [APPLE.mass, HAND.at + beyond]].map(([mass, x]) => ({ force: [0, -mass * GRAVITY, 0], at: [x, 0, 0] }));
    return { weights, wrench: weights.map(({ force, at }) => wrenchOf(force, at)).reduce(add) };
  }

  state() { return { t: this.t, ...this.at() }; }

  scene() {
    const { weights, wrench } = this.at(), [hand, apple] = weights;
    return [
      solid(boxFaces([0.02, 0.05, 0.03]), UPRIGHT, [-0.02, 0, 0], [150, 140, 130]), solid(boxFaces([0.05, 0.018, 0.02]), UPRIGHT, [0.05, 0, 0]), solid(boxFaces([0.035, 0.035, 0.03]), UPRIGHT, hand.at),
      solid(boxFaces([(apple.at[0] - 0.1) / 2, 0.007, 0.01]), UPRIGHT, [(apple.at[0] + 0.1) / 2, 0, 0]), solid(cylinderFaces(0.03, 0.03), UPRIGHT, apple.at, [196, 92, 84]),
      ...weights.map(({ force, at }) => arrowOf("wrench", at, times(PER_NEWTON, force), at === hand.at ? "hand" : "apple", { width: 5 })),
      ...turnArc(HERE, 2.2 * wrench[2], "wrench", "m", 0.07), { kind: "dot", at: HERE, name: "axes", label: "" },
    ];
  }

  numbers() { const { wrench } = this.at(); return [["force", decimal(-wrench[4], 2), "N down", "wrench"], ["moment", decimal(Math.abs(wrench[2]), 3), "N m", "wrench"]]; }
  truth() { return Math.abs(this.at(2 * APPLE.beyond).wrench[2]); }
  handle(beyond) { return [HAND.at + beyond, 0, 0]; }

  question() { // the sensor's moment about z, y upwards, of an apple of 0.2 kg at 0.2 m
    const [mass, beyond] = [0.2, 0.2], about = mass * GRAVITY * beyond;
    return { answer: -(HAND.mass * HAND.at + mass * (HAND.at + beyond)) * GRAVITY, other: { frame: [-about], named: [[-about, "That is the moment about the hand, and the sensor's was asked."]] } };
  }
}

const FORCE = [3, 4, 0], POINT_AT = [0.5, 0.3, 0]; // N, m

class Plane extends Picture {
  board() { return solid(boxFaces([0.75, 0.5, 0.02]), UPRIGHT, [0.35, 0.25, -0.06]); }
  force(at, label = "f") { return arrowOf("wrench", at, times(0.1, FORCE), label, { width: 5 }); }
  line(at) { const way = unit(FORCE); return { kind: "line", name: "wrench", width: 1.5, dashed: true, points: [add(at, times(-1.3, way)), add(at, times(1.3, way))] }; }
  origin(label = "{s}", R = UPRIGHT, p = HERE, towards = undefined) { return axes(R, p, 0.22, label, towards); }
}

class Sliding extends Plane {
  state() { const at = add(POINT_AT, times(this.values.along, unit(FORCE))); return { t: this.t, at, wrench: wrenchOf(FORCE, at) }; }
  scene() { const { at, wrench } = this.state(); return [this.board(), this.line(at), ...this.origin(), this.force(at), ...turnArc(HERE, 1.2 * wrench[2], "wrench", "m", 0.15)]; }
  numbers() { const { wrench } = this.state(); return [["(m, f)", planarText(wrench, 3), "N m, N", "wrench"]]; }
  truth() { return this.state().wrench[2]; }
  handle(along) { return add(POINT_AT, times(along, unit(FORCE))); }
}

class OffLine extends Plane {
  handle(off) { const [x, y] = unit(FORCE); return times(off, [y, -x, 0]); }

  state() {
    const { off } = this.values, at = this.handle(off);
    return { t: this.t, at, wrench: wrenchOf(FORCE, at), lever: off };
  }

  scene() {
    const { at, wrench } = this.state(), tip = add(at, times(0.1, FORCE));
    return [this.board(), this.line(at), { kind: "area", name: "wrench", corners: [HERE, at, tip, add(tip, times(-1, at))] }, ...this.origin(), { kind: "line", name: "change", width: 3, points: [HERE, at] }, this.force(at), ...turnArc(HERE, 1.2 * wrench[2], "wrench", "m", 0.15)];
  }

  numbers() { const { wrench, lever } = this.state(); return [["lever", decimal(lever, 2), "m", "change"], ["force", decimal(norm(FORCE), 0), "N", "wrench"], ["m", decimal(wrench[2], 2), "N m", "wrench"]]; }
}

const OBSERVER = [0.7, 0.45, 0]; // origin of {b} in {s}
const SPIN = [0, 0, 1.5], GLIDE = [0.4, -0.2, 0]; // rad/s; m/s of the point at the origin of {s}

class Observers extends Plane {
  handle(yaw) { return add(OBSERVER, rotated(turnAbout([0, 0, 1], radiansOf(yaw)), [0.22, 0, 0])); }

  at(yaw = radiansOf(this.values.yaw)) {
    const R = turnAbout([0, 0, 1], yaw), about = add(GLIDE, cross(SPIN, OBSERVER)); // velocity of the point at the origin of {b}
    const wrench_s = wrenchOf(FORCE, POINT_AT), wrench_b = wrenchOf(FORCE, POINT_AT, R, OBSERVER);
    const twist_s = [...SPIN, ...GLIDE], twist_b = [...rotatedBack(R, SPIN), ...rotatedBack(R, about)];
    return { R, p: OBSERVER, wrench_s, wrench_b, twist_s, twist_b, power_s: inner(twist_s, wrench_s), power_b: inner(twist_b, wrench_b) };
  }

  state() { return { t: this.t, ...this.at() }; }
  scene() { const { R } = this.at(); return [this.board(), this.line(POINT_AT), ...this.origin(), ...this.origin("{b}", R, OBSERVER, [0.6, 1]), this.force(POINT_AT)]; }
  numbers() { const { wrench_s, wrench_b } = this.at(); return [["in {s}", planarText(wrench_s), "", "wrench"], ["in {b}", planarText(wrench_b), "N m, N", "wrench"]]; }
}

class Power extends Observers {
  scene() {
    const speed = (p) => add(GLIDE, cross(SPIN, p));
    return [...super.scene(), arrowOf("twist", POINT_AT, times(0.35, speed(POINT_AT)), "v", { width: 4, beside: true }), { kind: "arc", middle: [0.2, 0.55, 0], radius: 0.1, sweep: 2.4, name: "twist", label: "ω" }];
  }

  numbers() { const { wrench_b, power_s, power_b } = this.at(); return [["ℱ in {b}", planarText(wrench_b), "N m, N", "wrench"], ["power in {s}", decimal(power_s, 3), "W", "line"], ["in {b}", decimal(power_b, 3), "W", "line"]]; }
  truth() { return this.at(0).power_b; }
}

class Screw extends Picture { // force along z, moment tilted from it
  moment(tilt = this.values.tilt) { return [2 * Math.sin(radiansOf(tilt)), 0, 2 * Math.cos(radiansOf(tilt))]; }
  handle(tilt) { return times(0.3, this.moment(tilt)); }

  state() {
    const f = [0, 0, 4], m = this.moment(), size = dot(f, f);
    const q = times(1 / size, cross(f, m)), pitch = dot(f, m) / size;
    return { t: this.t, wrench: [...m, ...f], q, pitch, rebuilt: [...add(cross(q, f), times(pitch, f)), ...f] };
  }

  scene() {
    const { wrench: [a, b, c, ...f], q, pitch } = this.state(), turn_ = times(pitch, f);
    return [
      ...floor(-0.3, 0.9, false), ...axes(UPRIGHT, HERE, 0.25, "{s}"), { kind: "line", name: "change", width: 2, dashed: true, points: [add(q, [0, 0, -0.3]), add(q, [0, 0, 1.35])] },
      arrowOf("momentum", HERE, times(0.3, [a, b, c]), "m", { width: 4 }), arrowOf("wrench", HERE, times(0.18, f), "f", { width: 4 }), { kind: "line", name: "change", width: 2, points: [HERE, q] },
      arrowOf("wrench", q, times(0.18, f), "push", { width: 6, beside: -1, along: 0.75 }), ...(norm(turn_) > 0.02 ? [arrowOf("momentum", add(q, [0, 0, 0.8]), times(0.22, turn_), "turn", { width: 4 })] : []),
    ];
  }

  numbers() { const { q, pitch } = this.state(); return [["the line passes at", decimal(norm(q), 3), "m", "change"], ["pitch", decimal(pitch, 3), "m", "momentum"]]; }
}

const PICTURES = { apple: Held, sliding: Sliding, offline: OffLine, observers: Observers, power: Power, screw: Screw };
