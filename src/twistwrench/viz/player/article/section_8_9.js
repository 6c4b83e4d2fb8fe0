// Section 8.9: a rotor of 1e-4 kg m² behind a gear of ratio G moves a link of 1 kg m².
"use strict";

const HERE = [0, 0, 0], ROTOR_INERTIA = 1e-4, LINK_INERTIA = 1, MOTOR = 0.5; // kg m², kg m², N m
const MOST = 200; // largest gear ratio
const reflected = (G) => G * G * ROTOR_INERTIA, acceleration = (G) => (G * MOTOR) / (LINK_INERTIA + reflected(G)); // of the link, kg m² and rad/s²

const linkAt = (angle, p = HERE) => [solid(boxFaces([0.5, 0.05, 0.04]), turnAbout([0, 0, 1], angle), add(p, [0.5 * Math.cos(angle), 0.5 * Math.sin(angle), 0])), solid(cylinderFaces(0.1, 0.06), UPRIGHT, p)];
const rotorAt = (angle, p, radius) => [solid(cylinderFaces(radius, 0.05), UPRIGHT, p, [176, 150, 118]), { kind: "line", name: "edge", width: 3, points: [p, add(p, [radius * Math.cos(angle), radius * Math.sin(angle), 0])] }];

// A curve over the gear ratio on logarithmic axes from 1 to 200, in a box at (1.5, 0) of 1.5 by 1.2.
function chart(count, least, most, { colour = "wrench" } = {}) {
  const x = (G) => 1.5 + (1.5 * Math.log(G)) / Math.log(MOST), y = (value) => 1.2 * Math.min(1, Math.max(0, (Math.log(value) - Math.log(least)) / (Math.log(most) - Math.log(least))));
  const ratios = Array.from({ length: 61 }, (_, k) => MOST ** (k / 60));
  const at = (G, value = count(G)) => [x(G), y(value), 0];
  return {
    at,
    things: [
      { kind: "floor", name: "line", width: 1.5, points: [[1.5, 0, 0], [3, 0, 0]] }, { kind: "floor", name: "line", width: 1.5, points: [[1.5, 0, 0], [1.5, 1.2, 0]] },
      ...[least, most].map((value) => ({ kind: "note", name: "line", at: [1.44 - 0.035 * general(value, 4).length, y(value), 0], label: general(value, 4) })),
      { kind: "line", name: colour, width: 3, points: ratios.map((G) => at(G)) },
      ...[1, 10, 100].map((G) => ({ kind: "dot", name: "line", at: [x(G), 0, 0], label: G === 1 ? "G = 1" : String(G), below: true })),
    ],
  };
}

class Geared extends Picture {
  get ratio() { return this.values.gear; }
  at(G = this.ratio) { return { gear: G, reflected: reflected(G), total: LINK_INERTIA + reflected(G), acceleration: acceleration(G) }; }
  state() { return { t: this.t, ...this.at() }; }
}

class Reflected extends Geared {
  scene() {
    const { at, things } = chart(reflected, 1e-4, 4), G = this.ratio;
    return [
      ...linkAt(0.2), ...rotorAt(0, [0, -0.42, 0], 0.13), arrowOf("wrench", [0.98 * Math.cos(0.2), 0.98 * Math.sin(0.2), 0], [-0.08, 0.34, 0], "push", { width: 5 }),
      ...things, { kind: "dot", name: "wrench", at: at(G), label: "G²I" },
    ];
  }

  numbers() { const { reflected: own } = this.at(); return [["G²I", general(own, 4), "kg m²", "wrench"], ["link", decimal(LINK_INERTIA, 0), "kg m²", "line"]]; }
  truth() { return reflected(MOST); }

  question() {
    const [G, inertia] = [160, 5e-5], felt = G * G * inertia;
    return { answer: felt, other: { named: [[LINK_INERTIA + felt, "That is the total with the link. The rotor's share was asked."], [G * inertia, "That has G once. The rotor also turns G times as fast."]] } };
  }
}

const SHOWN = 1; // rad/s², of the link

class Square extends Geared {
  state() { const G = this.ratio; return { t: this.t, gear: G, rotor_acceleration: G * SHOWN, rotor_torque: ROTOR_INERTIA * G * SHOWN, felt: G * ROTOR_INERTIA * G * SHOWN }; }

  scene() {
    const { gear, felt } = this.state(), wheel = 0.12 + 0.42 * (gear / 20);
    return [
      ...linkAt(0.25), solid(cylinderFaces(wheel, 0.03), UPRIGHT, [0, 0, -0.08]), ...rotorAt(0.5, [-(wheel + 0.1), 0, 0], 0.1),
      ...turnArc(HERE, 0.9, "twist", "1", 0.3), ...turnArc([-(wheel + 0.1), 0, 0], -Math.min(5.6, 0.9 * gear ** 0.6), "twist", "G", 0.17), ...turnArc(HERE, -Math.min(5.6, 40 * felt), "wrench", "", 0.2),
    ];
  }

  numbers() {
    const { gear, rotor_acceleration: fast, rotor_torque: torque, felt } = this.state();
    return [["rotor", `${decimal(gear, 0)} × ${decimal(SHOWN, 0)} = ${decimal(fast, 0)}`, "rad/s²", "twist"], ["its torque", decimal(torque, 4), "N m", "wrench"], [`× ${decimal(gear, 0)} at the link`, decimal(felt, 4), "N m", "wrench"]];
  }
}

class Best extends Geared {
  scene() {
    const { at, things } = chart(acceleration, 0.4, 30), G = this.ratio, now = this.at().acceleration;
    return [...linkAt(0.2), ...rotorAt(0, [0, -0.42, 0], 0.13), ...turnArc(HERE, Math.min(5.6, 0.2 * now), "twist", "θ̈", 0.3), ...things, { kind: "dot", name: "wrench", at: at(G), label: "θ̈" }];
  }

  numbers() { const { gear, acceleration: now } = this.at(); return [["G", decimal(gear, 0), "", "line"], ["acceleration for 0.5 N m", decimal(now, 2), "rad/s²", "twist"]]; }
  truth() { return Math.sqrt(LINK_INERTIA / ROTOR_INERTIA); }
}

const TILT = 1; // rad/s, about y

class Gyroscope extends Geared {
  state() { // moment Ω × L that turns the rotor's momentum, with the joint at 1 rad/s
    const spin = this.ratio * 1, L = [0, 0, ROTOR_INERTIA * spin], moment = cross([0, TILT, 0], L);
    return { t: this.t, gear: this.ratio, spin, momentum: L, moment };
  }

  scene() {
    const { momentum, moment } = this.state(), long = (a, s) => times(s, a);
    return [
      ...floor(-0.5, 0.9), solid(cylinderFaces(0.45, 0.06), UPRIGHT, HERE, [176, 150, 118]), arrowOf("twist", HERE, [0, 0.75, 0], "Ω", { width: 3 }),
      arrowOf("momentum", HERE, long(momentum, 50), "L", { width: 5 }), arrowOf("wrench", long(momentum, 50), long(moment, 40), "m", { width: 5, beside: true }),
    ];
  }

  numbers() { const { spin, momentum, moment } = this.state(); return [["rotor", decimal(spin, 0), "rad/s", "twist"], ["L", decimal(momentum[2], 4), "N m s", "momentum"], ["|Ω × L|", decimal(norm(moment), 4), "N m", "wrench"]]; }
}

class Matrix extends Geared {
  // Planar arm of two links of 1 m with 1 kg at each end, elbow at 90°, a rotor behind a gear in each joint.
  at(G = this.ratio) { const own = reflected(G), M = [[3 + own, 1], [1, 1 + own]]; return { gear: G, M, share: M[0][1] / Math.sqrt(M[0][0] * M[1][1]) }; }

  scene() {
    const { M } = this.at(), cell = (i, j) => { const [x, y, size] = [0.1 + 0.55 * j, 0.65 - 0.55 * i, 0.25 * Math.min(1, Math.sqrt(M[i][j] / 7))]; return { kind: "area", name: i === j ? "momentum" : "wrench", corners: [[x - size + 0.25, y - size + 0.25, 0], [x + size + 0.25, y - size + 0.25, 0], [x + size + 0.25, y + size + 0.25, 0], [x - size + 0.25, y + size + 0.25, 0]] }; };
    const { at, things } = chart((G) => this.at(G).share, 0.1, 1), frame = (i, j) => ({ kind: "line", name: "line", width: 1, points: [[0.1, 0.1], [0.6, 0.1], [0.6, 0.6], [0.1, 0.6], [0.1, 0.1]].map(([x, y]) => [x + 0.55 * j, y + 0.55 * (1 - i), 0]) });
    return [...[[0, 0], [0, 1], [1, 0], [1, 1]].flatMap(([i, j]) => [frame(i, j), ...[cell(i, j), cell(i, j)]]), ...things, { kind: "dot", name: "wrench", at: at(this.ratio), label: "share" }];
  }

  numbers() { const { M, share } = this.at(); return [["M₁₁", general(M[0][0], 4), "kg m²", "momentum"], ["M₁₂", decimal(M[0][1], 0), "kg m²", "wrench"], ["M₂₂", general(M[1][1], 4), "kg m²", "momentum"], ["coupling", decimal(100 * share, 1), "%", "wrench"]]; }
}

class Shoved extends Picture { // two links, G = 1 and G = 100, the same shove
  at(t = this.t) {
    const speeds = [1, 100].map((G) => this.values.shove / (LINK_INERTIA + reflected(G)));
    return { t, speeds, angles: speeds.map((w) => w * t) };
  }

  state() { return this.at(); }
  truth() { const [bare, geared] = this.at(0).speeds; return geared / bare; }

  scene() {
    const { angles, speeds } = this.at();
    return [0, 1].flatMap((k) => {
      const p = [1.7 * k, 0, 0], end = add(p, [Math.cos(angles[k]), Math.sin(angles[k]), 0]);
      return [...linkAt(angles[k], p), ...rotorAt([1, 100][k] * angles[k], add(p, [0, -0.4, 0]), 0.12), arrowOf("twist", end, times(0.6 * speeds[k], [-Math.sin(angles[k]), Math.cos(angles[k]), 0]), "", { width: 4 }), { kind: "note", name: "line", at: add(p, [0, -0.68, 0]), label: k ? "G = 100" : "G = 1" }];
    });
  }

  numbers() { const { speeds } = this.at(); return [["G = 1", decimal(speeds[0], 4), "rad/s", "twist"], ["G = 100", decimal(speeds[1], 4), "rad/s", "twist"]]; }
}

const PICTURES = { reflected: Reflected, square: Square, best: Best, gyroscope: Gyroscope, matrix: Matrix, shove: Shoved };
