// Section 8.3: inverse dynamics of a planar arm with 1 kg at the end of each link: motion outward, forces inward.
"use strict";

const POINT = 1, GRAVITY = 9.81; // kg, at the end of each link; m/s²
const PER_ACCELERATION = 0.2, PER_PUSH = 0.2, PER_MOMENT = 0.35, PER_RATE = 0.55; // m for a m/s²; m/N; rad of an arc for a N m; rad for a rad/s

class Wave extends Picture {
  get angles() { return [0, Math.PI / 2]; }
  get rates() { return [1, 1]; }
  get lift() { return [0, 0, 0]; } // acceleration of the base

  // Outward ω and a of each link's end, inward the force across each joint and the torque of its motor.
  at(angles = this.angles, [u, w] = this.rates, lift = this.lift) {
    const { elbow, fore, tip } = placesOf(angles), turns = [u, u + w];
    const a1 = add(lift, times(-(turns[0] ** 2), elbow)), a2 = add(a1, times(-(turns[1] ** 2), fore)), own = [a1, a2].map((a) => times(POINT, a));
    const across = [add(own[0], own[1]), own[1]], moment2 = cross(fore, across[1])[2], moment1 = cross(elbow, across[0])[2] + moment2;
    return { angles, rates: [u, w], elbow, fore, tip, turns, a: [a1, a2], own, across, tau: [moment1, moment2] };
  }

  state() { return { t: this.t, ...this.at() }; }
  body(now = this.at()) { return [...armBody(now.angles), ...[now.elbow, now.tip].map((p) => solid(cylinderFaces(0.12, 0.06), UPRIGHT, p, [120, 132, 148]))]; }
  spin({ turns, elbow }, k) { return turnArc([ORIGIN, elbow][k], PER_RATE * turns[k], "twist", `ω${"₁₂"[k]}`, 0.34); }
  end({ elbow, tip }, k) { return [elbow, tip][k]; }
  quickening(now, k) { return arrowOf("change", this.end(now, k), times(PER_ACCELERATION, now.a[k]), `a${"₁₂"[k]}`, { width: 4 }); }
  asked(now, k) { return arrowOf("wrench", this.end(now, k), times(PER_PUSH, now.own[k]), `f${"₁₂"[k]}`, { width: 5 }); }
  carried(now, k) { return arrowOf("wrench", [ORIGIN, now.elbow][k], times(PER_PUSH, now.across[k]), `F${"₁₂"[k]}`, { width: 6 }); }
  torque({ tau, elbow }, k) { return turnArc([ORIGIN, elbow][k], PER_MOMENT * tau[k], "wrench", `τ${"₁₂"[k]}`, 0.2); }
}

const flat = ([x, y], decimals = 2) => vectorText([x, y], decimals);

class Outward extends Wave {
  scene() {
    const now = this.at(), shown = [0, 1].filter((k) => k < this.values.beat);
    return [...this.body(now), ...shown.flatMap((k) => [...this.spin(now, k), this.quickening(now, k)])];
  }

  numbers() {
    const { turns, a } = this.at(), rows = [0, 1].filter((k) => k < this.values.beat);
    if (!rows.length) return [["base", "at rest, a = 0", "", "line"]];
    return rows.flatMap((k) => [[`ω${"₁₂"[k]}`, decimal(turns[k], 0), "rad/s", "twist"], [`a${"₁₂"[k]}`, flat(a[k], 0), "m/s²", "change"]]);
  }
}

class Alone extends Wave {
  get rates() { return [this.values.rate, 1]; }
  scene() { const now = this.at(); return [...this.body(now), ...[0, 1].flatMap((k) => [this.asked(now, k)])]; }
  numbers() { const { own } = this.at(); return [["f₁", flat(own[0]), "N", "wrench"], ["f₂", flat(own[1]), "N", "wrench"]]; }
}

class Inward extends Wave {
  scene() {
    const now = this.at(), shown = [1, 0].filter((k) => 2 - k <= this.values.beat);
    return [...this.body(now), ...[0, 1].map((k) => ({ ...this.asked(now, k), width: 3, name: "change" })), ...shown.map((k) => this.carried(now, k))];
  }

  numbers() {
    const { across } = this.at(), shown = [1, 0].filter((k) => 2 - k <= this.values.beat);
    return shown.length ? shown.map((k) => [`joint ${k + 1} carries`, flat(across[k], 0), "N", "wrench"]) : [["beyond the tip", "nothing: 0", "N", "line"]];
  }

  question() { // the size of the force across joint 1, at 2 and 1 rad/s
    const { across, own, angles } = this.at([0, Math.PI / 2], [2, 1], [0, 0, 0]), R = turnAbout([0, 0, 1], angles[0] + angles[1]), inTip = rotatedBack(R, across[0]);
    return {
      answer: norm(across[0]),
      other: { frame: [inTip[0], inTip[1]], named: [[norm(own[1]), "That is what link 2 alone asks for. Joint 1 carries link 1 as well."], [norm(own[0]), "That is what link 1 alone asks for. Joint 1 carries link 2 as well."], [inTip[0], "That is one component in {2}, and the size was asked."], [inTip[1], "That is one component in {2}, and the size was asked."]] },
    };
  }
}

class Motor extends Wave {
  get angles() { return [0, radiansOf(this.values.bend)]; }
  handle(bend) { return placesOf([0, radiansOf(bend)]).tip; }
  scene() { const now = this.at(); return [...this.body(now), ...[0, 1].flatMap((k) => [this.carried(now, k), ...this.torque(now, k)])]; }
  numbers() { const { tau, across } = this.at(); return [0, 1].flatMap((k) => [[`τ${"₁₂"[k]}`, decimal(tau[k], 3), "N m", "wrench"], [`bearing ${k + 1}`, decimal(norm(across[k]), 3), "N", "line"]]); }
  truth() { return this.at([0, Math.PI / 2]).tau[0]; }
}

class Lift extends Wave {
  get lift() { return [0, this.values.lift, 0]; }

  state() { // torques under gravity of the same size instead, by virtual work: the rate of the weight's energy for each joint
    const now = this.at(), still = this.at(this.angles, this.rates, [0, 0, 0]), weight = [0, -POINT * this.values.lift, 0];
    const gravity = [-(momentAbout(ORIGIN, now.elbow, weight) + momentAbout(ORIGIN, now.tip, weight)), -momentAbout(now.elbow, now.tip, weight)];
    return { t: this.t, ...now, without: still.tau, gravity };
  }

  scene() {
    const now = this.at(), lift = this.values.lift;
    const push = (from, way, name, label, more = {}) => arrowOf(name, from, way, label, { width: 4, ...more });
    return [
      ...this.body(now), ...(lift ? [push([0, -0.75, 0], [0, 0.06 * lift, 0], "twist", "lift", { width: 6, beside: true, along: 0.5 })] : []), { kind: "line", name: "edge", width: 4, points: [[-0.35, -0.1, 0], [0.35, -0.1, 0]] },
      ...[0, 1].map((k) => arrowOf("change", this.end(now, k), times(0.07, now.a[k]), `a${"₁₂"[k]}`)), ...turnArc(ORIGIN, 0.1 * now.tau[0], "wrench", "τ₁"), ...turnArc(now.elbow, 0.3 * now.tau[1], "wrench", "τ₂"),
    ];
  }

  numbers() {
    const { tau, without, gravity } = this.state();
    return [["τ₁", decimal(tau[0], 2), "N m", "wrench"], ["without lift", decimal(without[0], 2), "N m", "change"], ["weight at rest", decimal(gravity[0], 2), "N m", "line"]];
  }
}

class Count extends Picture {
  state() { const { links: n } = this.values; return { t: this.t, links: n, wave: 2 * n, symbols: n ** 3 }; }

  scene() {
    const { links, wave, symbols } = this.state(), x = (n) => 0.2 + n / 12, most = 600, y = (count) => 1.7 * Math.min(1, count / most), upTo = Array.from({ length: 30 }, (_, k) => k + 1);
    const curve = (name, count) => ({ kind: "line", name, width: 3, points: upTo.filter((n) => count(n) <= most).map((n) => [x(n), y(count(n)), 0]) });
    return [
      { kind: "floor", name: "line", width: 1.5, points: [[0.2, 0, 0], [2.8, 0, 0]] }, { kind: "floor", name: "line", width: 1.5, points: [[0.2, 0, 0], [0.2, 1.75, 0]] },
      curve("twist", (n) => 2 * n), curve("wrench", (n) => n ** 3), { kind: "dot", name: "twist", at: [x(links), y(wave), 0], label: "wave", below: true },
      ...(symbols <= most ? [{ kind: "dot", name: "wrench", at: [x(links), y(symbols), 0], label: "symbols" }] : []),
    ];
  }

  numbers() { const { links, wave, symbols } = this.state(); return [["joints", decimal(links, 0), "", "line"], ["visits of a link", decimal(wave, 0), "", "twist"], ["Christoffel symbols", decimal(symbols, 0), "", "wrench"]]; }
}

const PICTURES = { outward: Outward, alone: Alone, inward: Inward, motor: Motor, lift: Lift, count: Count };
