// Section 8.1: torques of a planar arm at constant joint rates, with 1 kg at the end of each link, without gravity.
"use strict";

const POINT = 1; // kg, at the end of each link
const PER_PUSH = 0.16, PER_MOMENT = 0.35, PER_RATE = 0.8, PER_SPEED = 0.35; // m/N; rad of an arc for a N m; rad for a rad/s; m for a m/s
const along = (angle, length) => [length * Math.cos(angle), length * Math.sin(angle), 0];
const acrossTo = (rate, p) => cross([0, 0, rate], p); // velocity by a turn

class Turning extends Picture {
  get angles() { return [0, Math.PI / 2]; }
  get rates() { return [1, 1]; }

  // Places, velocities and accelerations of both masses, the forces for them, and the torques about the joints.
  at(angles = this.angles, [u, w] = this.rates) {
    const { elbow, fore, tip } = placesOf(angles), v1 = acrossTo(u, elbow), v2 = add(v1, acrossTo(u + w, fore));
    const a1 = times(-u * u, elbow), a2 = add(a1, times(-((u + w) ** 2), fore)), f1 = times(POINT, a1), f2 = times(POINT, a2);
    const tau = [momentAbout(ORIGIN, elbow, f1) + momentAbout(ORIGIN, tip, f2), momentAbout(elbow, tip, f2)];
    return { angles, rates: [u, w], elbow, fore, tip, v: [v1, v2], a: [a1, a2], f: [f1, f2], tau, h: POINT * LINK * LINK * Math.sin(angles[1]), energy: (POINT / 2) * (dot(v1, v1) + dot(v2, v2)) };
  }

  state() { return { t: this.t, ...this.at() }; }

  masses({ elbow, tip }) { return [elbow, tip].map((p) => solid(cylinderFaces(0.12, 0.06), UPRIGHT, p, [120, 132, 148])); }
  spins({ rates, elbow }) { return [...turnArc(ORIGIN, PER_RATE * rates[0], "twist", rates[0] ? "θ̇₁" : "", 0.46), ...turnArc(elbow, PER_RATE * rates[1], "twist", rates[1] ? "θ̇₂" : "", 0.46)]; }
  torques({ tau, elbow }) { return [...turnArc(ORIGIN, PER_MOMENT * tau[0], "wrench", "τ₁", 0.2), ...turnArc(elbow, PER_MOMENT * tau[1], "wrench", "τ₂", 0.2)]; }
  pushes({ f, elbow, tip }, labels = ["", "f₂"]) { return f.flatMap((force, k) => (norm(force) > 1e-9 ? [arrowOf("wrench", [elbow, tip][k], times(PER_PUSH, force), labels[k], { width: 5 })] : [])); }
  body(now) { return [...armBody(now.angles), ...this.masses(now)]; }

  scene() {
    const now = this.at(), { f, tip, elbow } = now;
    return [...(norm(f[1]) > 1e-9 ? leversTo([ORIGIN, elbow], tip, unit(f[1]), [0.6, 2.6], { shifts: this.shifts }) : []), ...this.body(now), ...this.spins(now), ...this.torques(now), ...this.pushes(now)];
  }

  numbers() { return this.at().tau.map((x, k) => [`τ${"₁₂"[k]}`, decimal(x, 3), "N m", "wrench"]); }
}

class Centripetal extends Turning { get rates() { return [this.values.rate, 0]; } }
class Folding extends Turning {
  get rates() { return [0, this.values.rate]; }
  get shifts() { return [0.15]; } // the lever of joint 1 lies along link 1
}

class Both extends Turning {
  get rates() { return [1, this.values.rate]; }
  truth() { return this.at(undefined, [1, 1]).tau[0]; }
  question() {
    const [u, w] = [2, 1], h = POINT * LINK * LINK; // rad/s, at 90°
    return {
      answer: this.at(undefined, [u, w]).tau[0],
      other: {
        degrees: [-h * Math.sin(90) * (2 * u * w + w * w)], // the sine of 90 rad
        named: [[-2 * h * u * w, "That is the Coriolis part alone. The centripetal part of joint 2's own turning comes on top."], [-h * w * w, "That is the centripetal part alone, as if the other joint stood still."], [-3, "That is the torque at 1 rad/s each."]],
      },
    };
  }
}

class Halves extends Turning {
  get rates() { return [this.values.rate, 1]; }

  // Coriolis acceleration 2 ω × v of mass 2, v its velocity beside link 1: once as link 1 turns v, once as v takes the mass to where link 1 moves otherwise.
  state() {
    const now = this.at(), [u, w] = now.rates, v = acrossTo(w, now.fore), half = times(POINT, acrossTo(u, v));
    return { t: this.t, ...now, beside: v, half, moment: momentAbout(ORIGIN, now.tip, half), carried: momentAbout(ORIGIN, now.tip, times(POINT, times(-w * w, now.fore))) };
  }

  scene() {
    const now = this.state(), { tip, beside, half } = now, long = times(0.6, half);
    return [
      ...this.body(now), ...this.spins(now), arrowOf("twist", tip, times(0.5, beside), "v", { width: 4 }),
      ...(norm(half) > 1e-9 ? [arrowOf("wrench", tip, long, "turns v", { width: 5, beside: true }), arrowOf("change", add(tip, long), long, "other place", { width: 5, beside: true })] : []),
    ];
  }

  numbers() {
    const { moment } = this.state();
    return [["turning of v", decimal(moment, 3), "N m", "wrench"], ["other place", decimal(moment, 3), "N m", "change"], ["together", decimal(2 * moment, 3), "N m", "line"]];
  }
}

class Faster extends Turning {
  get rates() { return [this.values.factor, this.values.factor]; }
  pushes(now) { return now.f.flatMap((force, k) => (norm(force) > 1e-9 ? [arrowOf("wrench", [now.elbow, now.tip][k], times(0.06, force), "", { width: 5 })] : [])); }
  torques({ tau, elbow }) { return [...turnArc(ORIGIN, 0.12 * tau[0], "wrench", "τ₁", 0.2), ...turnArc(elbow, 0.12 * tau[1], "wrench", "τ₂", 0.2)]; }
  spins({ rates, elbow }) { return [...turnArc(ORIGIN, 0.4 * rates[0], "twist", "", 0.34), ...turnArc(elbow, 0.4 * rates[1], "twist", "", 0.34)]; }
  truth() { const tau = (s) => this.at(undefined, [s, s]).tau[0]; return tau(2) / tau(1); }
}

class Bent extends Turning {
  get angles() { return [0, radiansOf(this.values.bend)]; }
  handle(bend) { return placesOf([0, radiansOf(bend)]).tip; }
}

const MOMENT = 1e-5; // s, on both sides of now

class Energy extends Bent {

  // Power of the torques, and the rate of the kinetic energy from two moments.
  state() {
    const now = this.at(), [u, w] = now.rates, [a, b] = now.angles, energy = (t) => this.at([a + u * t, b + w * t]).energy;
    const coriolis = -now.h * 2 * u * w, own = -now.h * w * w;
    return { t: this.t, ...now, power: u * now.tau[0] + w * now.tau[1], rate: (energy(MOMENT) - energy(-MOMENT)) / (2 * MOMENT), momentum_rate: [coriolis + own, -now.h * u * w], half_slope: [0, -now.h * (u * u + u * w)] };
  }

  scene() {
    const now = this.state(), { energy, power } = now, bar = (x, height, name) => ({ kind: "area", name, corners: [[x, 0.2, 0], [x + 0.3, 0.2, 0], [x + 0.3, 0.2 + height, 0], [x, 0.2 + height, 0]] });
    return [
      ...this.body(now), ...this.spins(now), ...this.torques(now), ...[now.v[0], now.v[1]].map((v, k) => arrowOf("twist", [now.elbow, now.tip][k], times(PER_SPEED, v), k ? "v₂" : "v₁", { width: 4 })),
      bar(2.15, energy / 6, "momentum"), { kind: "note", name: "momentum", at: [2.3, 0.06, 0], label: "energy" }, bar(2.75, power / 3, "wrench"), { kind: "note", name: "wrench", at: [2.9, power < 0 ? 0.34 : 0.06, 0], label: "power" },
    ];
  }

  numbers() {
    const { energy, power, rate } = this.state();
    return [["kinetic energy", decimal(energy, 3), "J", "momentum"], ["its rate", decimal(rate, 3), "W", "momentum"], ["power of the motors", decimal(power, 3), "W", "wrench"]];
  }
}

const PICTURES = { centripetal: Centripetal, folding: Folding, both: Both, halves: Halves, faster: Faster, bent: Bent, energy: Energy };
