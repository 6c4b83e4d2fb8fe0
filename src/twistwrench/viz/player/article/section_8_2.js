// Section 8.2: the momentum of a body in the room and on the body.
"use strict";

const CARTON = { moments: [0.02, 0.06, 0.07], mass: 1, half: [0.4062, 0.2121, 0.1225] }; // uniform: 81 × 42 × 24 cm
const PER_MOMENTUM = 4.6, PER_TWIST = 0.27; // m of arrow for a unit
const HERE = [0, 0, 0];

class Thrown extends Picture { // from a throw, with the spin of a slider about axis 1
  restart() {
    const V = [this.values.spin ?? 1.6, 0.35, 2.6, 0, 0, 0];
    this.body = new RigidBody(CARTON.moments, CARTON.mass);
    this.flight = new Flight(this.body, { R: UPRIGHT, V });
  }

  at(t = this.t) {
    const { R, V } = this.flight.at(t), P = this.body.momentum(V);
    return { t, R, twist_body: V, momentum_body: P, momentum_room: inRoom(R, P), adT_momentum: changeByTurning(V, P) };
  }

  state() { return this.at(); }
  frame() { return this.at().R; }
  headRoom(t) { return times(PER_MOMENTUM, angular(this.at(t).momentum_room)); }

  // Carton, twist and momentum as they are in the room.
  scene(view) {
    const { R, twist_body, momentum_room } = this.state();
    const { perTwist } = this, spin = (t) => { const s = this.at(t); return times(perTwist, rotated(s.R, angular(s.twist_body))); };
    const onBody = (head) => (t) => rotated(R, rotatedBack(this.at(t).R, head(t))); // the trail that is left on the body
    const seen = view === "body" ? onBody : (head) => head;
    return [
      ...floor(-0.85), solid(boxFaces(CARTON.half), R),
      trail("twist", seen(spin), this.t), trail("momentum", seen((t) => this.headRoom(t)), this.t),
      arrowOf("twist", HERE, times(perTwist, rotated(R, angular(twist_body))), "ω", { width: 3, beside: true }),
      arrowOf("momentum", HERE, times(PER_MOMENTUM, angular(momentum_room)), "𝒫", { width: 5 }),
      ...(this.guess ? [arrowOf("momentum", HERE, times(PER_MOMENTUM, this.guess), "?", { dashed: true, width: 4 })] : []),
    ];
  }

  get grasped() { return angular(this.at(0).momentum_room); } // arrow that a guess begins with
  truth(t) { return angular(this.at(t).momentum_room); }
  get perUnit() { return PER_MOMENTUM; }
  get perTwist() { return PER_TWIST; }
}

class Throw extends Thrown {
  numbers() {
    const { momentum_room, twist_body, R } = this.state();
    return [["𝒫 in the room", vectorText(angular(momentum_room), 4), "N m s", "momentum"], ["ω in the room", vectorText(rotated(R, angular(twist_body)), 2), "rad/s", "twist"]];
  }
}

class OnBody extends Thrown {
  numbers() {
    const { momentum_room, momentum_body } = this.state();
    return [["𝒫 in the room", vectorText(angular(momentum_room), 4), "", "momentum"], ["on the box", vectorText(angular(momentum_body), 4), "N m s", "momentum"]];
  }
}

const GLANCE = 1e-4; // s, on both sides of a moment

class Tangent extends Thrown {
  get perTwist() { return 0.16; } // its head apart from the grey arrow

  // Velocity of the head on the body, from two moments.
  glimpsed() {
    const head = (t) => angular(this.at(t).momentum_body), first = Math.max(0, this.t - GLANCE), last = first + 2 * GLANCE;
    return times(1 / (last - first), add(head(last), times(-1, head(first))));
  }

  scene() {
    const { R, momentum_body, adT_momentum } = this.state(), head = rotated(R, times(PER_MOMENTUM, angular(momentum_body)));
    const way = (rate) => rotated(R, times(PER_MOMENTUM, rate));
    const seen = way(this.glimpsed()), shown = super.scene("body").filter(({ kind, name }) => name !== "twist" || kind === "arrow");
    return [...shown, { kind: "line", name: "momentum", width: 2, dashed: true, points: [add(head, times(-1, seen)), add(head, times(1.7, seen))] }, { kind: "dot", name: "momentum", at: add(head, seen) }, arrowOf("change", head, way(angular(adT_momentum)), "[ad]ᵀ𝒫", { width: 3.5, along: 0.5, beside: -1 })];
  }

  numbers() {
    const { adT_momentum } = this.state();
    return [["seen", vectorText(this.glimpsed(), 4), "", "momentum"], ["[ad]ᵀ𝒫", vectorText(angular(adT_momentum), 4), "N m", "change"]];
  }
}

const PUSHED = 8; // m of arrow for a unit of momentum
const PER_WRENCH = 8; // m of arrow for a unit of moment, the way of the head in a second

class Push extends Thrown { // spins about axis 3 and is pushed about axis 2 by thrusters on the box
  restart() {
    const V = [0, 0, 1.2, 0, 0, 0];
    this.body = new RigidBody(CARTON.moments, CARTON.mass);
    this.flight = new Flight(this.body, { R: UPRIGHT, V }, [0, this.values.moment, 0, 0, 0, 0]);
  }

  state() {
    const now = this.at(), wrench = [0, this.values.moment, 0, 0, 0, 0];
    return { ...now, wrench_body: wrench, wrench_room: inRoom(now.R, wrench) };
  }

  headRoom(t) { return times(PUSHED, angular(this.at(t).momentum_room)); }
  get perUnit() { return PUSHED; }

  scene() {
    const { R, momentum_room, wrench_room } = this.state(), head = this.headRoom(this.t), side = rotated(R, [0.44, 0, 0]);
    const blow = (sign) => arrowOf("wrench", add(times(sign, side), rotated(R, [0, 0, sign * 0.14])), rotated(R, [0, 0, -sign * Math.sign(-this.values.moment || -1) * -0.3]), "", { width: 2.5 });
    return [
      ...floor(-0.75), solid(boxFaces(CARTON.half), R), trail("momentum", (t) => this.headRoom(t), this.t),
      ...(this.values.moment ? [blow(1), blow(-1)] : []), arrowOf("axes", HERE, rotated(R, [0, 0.5, 0]), "axis 2", { width: 2 }),
      arrowOf("momentum", HERE, times(PUSHED, angular(momentum_room)), "𝒫", { width: 5 }),
      arrowOf("wrench", head, times(PER_WRENCH, angular(wrench_room)), "ℱ", { width: 4 }),
      ...(this.guess ? [arrowOf("momentum", HERE, times(PUSHED, this.guess), "?", { dashed: true, width: 4 })] : []),
    ];
  }

  numbers() {
    const { momentum_room, wrench_room } = this.state();
    return [["𝒫 in the room", vectorText(angular(momentum_room), 3), "N m s", "momentum"], ["ℱ in the room", vectorText(angular(wrench_room), 3), "N m", "wrench"]];
  }
}

const ROTOR = { moments: [0.01, 0.01, 0.02], speed: 50, radius: 0.42, half: 0.045 };
const ASKED = { tilt: 8, speed: 60 }; // of the exercise; degrees, rad/s

class Rotor extends Picture { // on a shaft along z, its own axis tilted by β; speed constant
  get tilt() { return radiansOf(this.values.tilt); }

  // State at a tilt [rad]: 𝒱̇ = 0, so ℱ = −ad(𝒱)ᵀ 𝒢 𝒱.
  at(t, tilt, speed = ROTOR.speed) {
    const V = [speed * Math.sin(tilt), 0, speed * Math.cos(tilt), 0, 0, 0], P = new RigidBody(ROTOR.moments, 1).momentum(V);
    const F = times(-1, changeByTurning(V, P)), R = productOf(turnAbout([0, 0, 1], speed * t), turnAbout([0, 1, 0], -tilt));
    return { t, R, twist_body: V, momentum_body: P, momentum_room: inRoom(R, P), wrench_body: F, wrench_room: inRoom(R, F), adT_momentum: changeByTurning(V, P) };
  }

  state() { return this.at(this.t, this.tilt); }
  frame() { return this.state().R; }

  scene(view) {
    const { R, wrench_room, twist_body } = this.state(), long = 0.84, perMomentum = 0.52 / (ROTOR.speed * ROTOR.moments[2]), pull = times(0.05, angular(wrench_room));
    const head = (t) => times(perMomentum, angular(this.at(t, this.tilt).momentum_room)), period = (2 * Math.PI) / ROTOR.speed;
    const shaft = [[0, 0, -long], [0, 0, long]], bearing = (z) => solid(cylinderFaces(0.09, 0.05, 12), UPRIGHT, [0, 0, z], [150, 140, 130]);
    const fixed_ = trail("momentum", head, period, period, period / 60).points;
    return [
      ...floor(-0.86, 0.8, false), { kind: "floor", points: shaft, name: "edge", width: 5 }, bearing(-0.72), bearing(0.72), solid(cylinderFaces(ROTOR.radius, ROTOR.half), R),
      { kind: "line", points: fixed_, name: "momentum", width: 1.5 },
      arrowOf("twist", HERE, times(0.0062, rotated(R, angular(twist_body))), "ω", { width: 3, beside: -1 }),
      arrowOf("momentum", HERE, head(this.t), "𝒫", { width: 5, beside: true, along: 0.72 }),
      arrowOf("wrench", head(this.t), pull, "ℱ", { width: 3 }),
      ...(view === "body" ? [arrowOf("change", head(this.t), times(-1, pull), "[ad]ᵀ𝒫", { width: 3 })] : []),
    ];
  }

  numbers() {
    const { wrench_body, twist_body, momentum_body } = this.state();
    return [["|m|", decimal(norm(angular(wrench_body)), 3), "N m", "wrench"], ["from ω to 𝒫", decimal(degreesOf(angleBetween(angular(twist_body), angular(momentum_body))), 1), "°", "momentum"]];
  }

  truth() { return norm(angular(this.at(0, this.tilt).wrench_body)); }

  question() { // |m| at 8° and 60 rad/s
    const { tilt, speed } = ASKED, moment = (t, angle) => this.at(t, angle, speed), { wrench_room } = moment(this.t, radiansOf(tilt)), wrong = norm(angular(moment(0, tilt).wrench_body)); // the sine of 8 rad
    return { answer: norm(angular(wrench_room)), other: { frame: angular(wrench_room), degrees: [wrong, -wrong] } };
  }
}

const SLED = { mass: 2, speed: 0.2, half: [0.11, 0.07, 0.05] };

class MovedFrame extends Picture { // slides along x without turning; {b} is beside the mass centre, along y
  state() {
    const { offset } = this.values, V = [0, 0, 0, SLED.speed, 0, 0], f = times(SLED.mass, linear(V)), m = cross([0, -offset, 0], f);
    const P = [...m, ...f];
    return { t: this.t, offset, twist_body: V, momentum_body: P, adT_momentum: changeByTurning(V, P), energy: inner(V, P) / 2 };
  }

  scene() {
    const { offset, momentum_body: P } = this.state(), x = SLED.speed * this.t - 0.25, mass = [x, 0, 0], origin = [x, offset, 0], f = times(0.6, linear(P));
    return [
      ...grid(0.8, 0.1), solid(boxFaces(SLED.half), UPRIGHT, mass), { kind: "area", name: "momentum", corners: [origin, add(origin, f), add(mass, f), mass] },
      { kind: "line", points: [origin, mass], name: "change", width: 2, dashed: true }, ...axes(UPRIGHT, origin, 0.09, "{b}"),
      arrowOf("momentum", mass, f, "p", { width: 5 }),
      ...(offset ? [{ kind: "arc", middle: origin, radius: 0.13, sweep: 14 * P[2], name: "momentum", label: "L" }] : []),
    ];
  }

  numbers() {
    const { momentum_body: P, adT_momentum: change, energy } = this.state();
    return [["L", decimal(P[2], 3), "N m s", "momentum"], ["p", decimal(P[3], 2), "N s", "momentum"], ["v × p", decimal(-change[2] + 0, 3), "N m", "change"], ["energy", decimal(energy, 3), "J", "line"]];
  }

  handle(offset) { return [SLED.speed * this.t - 0.25, offset, 0]; }
  question() { return { answer: 3 * 0.5 * 0.2 }; } // 3 kg at 0.5 m/s, {b} 0.2 m beside it
}

const STONE = { mass: 2, moment: 0.008, away: 0.5, speed: 2, radius: 0.1 }; // on a string; kg, kg m², m, rad/s, m

class OffCentre extends Picture { // a stone goes round the hub; {b} is beside it
  handle(offset) { return rotated(this.frame(), [STONE.away, offset, 0]); }

  state() {
    const { offset } = this.values, w = [0, 0, STONE.speed], V = [...w, ...cross(w, [STONE.away, offset, 0])];
    const f = times(STONE.mass, cross(w, [STONE.away, 0, 0])), P = [...add(times(STONE.moment, w), cross([0, -offset, 0], f)), ...f];
    const F = times(-1, changeByTurning(V, P)), R = turnAbout([0, 0, 1], STONE.speed * this.t);
    return { t: this.t, offset, R, twist_body: V, momentum_body: P, adT_momentum: changeByTurning(V, P), wrench_body: F, wrench_room: inRoom(R, F) };
  }

  frame() { return this.state().R; }

  scene() {
    const { offset, R, wrench_body: F, momentum_body: P, twist_body: V } = this.state(), stone = rotated(R, [STONE.away, 0, 0]), origin = rotated(R, [STONE.away, offset, 0]);
    const pull = times(0.07, rotated(R, linear(F))), v = times(0.36, rotated(R, linear(V))), f = times(0.13, rotated(R, linear(P)));
    return [
      ...grid(1, 0.2), { kind: "line", points: [HERE, stone], name: "edge", width: 2 }, { kind: "dot", at: HERE, name: "edge", label: "" },
      solid(cylinderFaces(STONE.radius, 0.04), R, stone), { kind: "area", name: "change", corners: [origin, add(origin, v), add(origin, add(v, f)), add(origin, f)] },
      ...axes(R, origin, 0.11, "{b}", [1, 0.7]), arrowOf("twist", origin, v, "v", { width: 3 }), arrowOf("momentum", origin, f, "p", { width: 4, beside: -1 }),
      arrowOf("wrench", stone, pull, "ℱ", { width: 5, beside: true }),
      ...(offset ? [{ kind: "line", points: [origin, stone], name: "wrench", width: 2, dashed: true }] : []),
    ];
  }

  numbers() {
    const { wrench_body: F, twist_body: V, momentum_body: P } = this.state();
    return [["v × p", decimal(cross(linear(V), linear(P))[2], 3), "N m", "change"], ["pull", decimal(norm(linear(F)), 2), "N", "wrench"], ["its lever", decimal(this.values.offset, 3), "m", "wrench"], ["moment", decimal(F[2], 3), "N m", "wrench"]];
  }
}

const CORNERS = [[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, -1, 0, 0, 0], [0, 0, 0, -1, 0, 0]]; // 𝒱₁, 𝒱₂ and back

class Bracket extends Picture { // one leg a second
  get h() { return this.values.h; }

  at(t) { // pose of the car in the plane
    let R = UPRIGHT, p = HERE;
    CORNERS.forEach((V, k) => {
      const s = this.h * Math.min(1, Math.max(0, t - k));
      p = add(p, rotated(R, times(s, linear(V))));
      R = productOf(R, turnAbout([0, 0, 1], s * V[2]));
    });
    return { R, p };
  }

  state() {
    const { R, p } = this.at(this.t), gap = [0, 0, 0, ...this.at(4).p], first = times(this.h ** 2, bracket(CORNERS[0], CORNERS[1]));
    return { t: this.t, h: this.h, R, p, gap, bracket: first, size: norm(linear(gap)) };
  }

  scene() {
    const { R, p } = this.state(), middle = [0.2, 0.15, 0], shifted_ = (a) => add(a, times(-1, middle));
    const end = this.at(4).p, arrived = this.t >= 4;
    const wheel = (side) => solid(boxFaces([0.034, 0.009, 0.02]), R, shifted_(add(p, rotated(R, [0, side * 0.055, 0]))), [90, 95, 105]);
    const way = [...Array(41).keys()].map((k) => shifted_(this.at((this.t * k) / 40).p));
    return [
      ...grid(0.6, 0.1), { kind: "line", points: way, name: "twist", width: 3 }, solid(cylinderFaces(0.05, 0.02), R, shifted_(p)), wheel(1), wheel(-1),
      ...axes(R, shifted_(p), 0.1, ""), { kind: "dot", at: shifted_(HERE), name: "edge", label: "" }, { kind: "note", at: shifted_([0.09, -0.05, 0]), name: "edge", label: "start" },
      ...(arrived ? [arrowOf("change", shifted_(HERE), end, "", { width: 4 }), { kind: "note", at: add(shifted_(times(0.5, end)), [-0.11, 0, 0]), name: "change", label: "gap" }] : []),
    ];
  }

  numbers() {
    const { size } = this.state();
    return [["gap", decimal(size, 4), "m", "change"], ["h²", decimal(this.h ** 2, 4), "", "line"], ["gap / h²", decimal(size / this.h ** 2, 4), "", "change"]];
  }

  truth() { const size = (h) => 2 * h * Math.sin(h / 2); return size(0.4) / size(0.2); }
  question() { const [angle, way] = [0.3, 0.5]; return { answer: 2 * way * Math.sin(angle / 2), other: { degrees: [2 * way * Math.sin(radiansOf(angle) / 2)] } }; } // a turn of 0.3 rad, a drive of 0.5 m
}

const PICTURES = { throw: Throw, body: OnBody, tangent: Tangent, push: Push, rotor: Rotor, frame: MovedFrame, centre: OffCentre, bracket: Bracket };
