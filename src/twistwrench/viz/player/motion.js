// A motion through inverse dynamics: its torques under the payload, the push and the speed that are set, and their peaks.
"use strict";

class Motion {
  constructor(mechanics, data, array) {
    const { robot } = mechanics, nq = robot.coordinates.length, nv = robot.torques.length;
    const rows = (spec, n) => { const all = array(spec); return Array.from({ length: all.length / n }, (_, i) => all.subarray(n * i, n * (i + 1))); };
    Object.assign(this, { mechanics, nv, data, time: array(data.time), pace: 1 }); // pace: speed of the motion, 1 as it was given
    this.q = rows(data.q, nq);
    this.dq = rows(data.dq, nv);
    this.ddq = rows(data.ddq, nv);
    this.still = data.still && rows(data.still, nv);
    this.limits = robot.torques.map(({ limit }) => limit ?? Infinity);
    this.zero = new Float64Array(nv);
    this.tau = new Float64Array(nv * this.time.length); // by rows
    mechanics.mass = data.mass;
    this.run();
  }

  get begin() { return this.time[0]; }
  get end() { return this.time[this.time.length - 1]; }
  shown(time) { return this.begin + (time - this.begin) / this.pace; } // on the clock of the motion as fast as it is now
  given(time) { return this.begin + (time - this.begin) * this.pace; }
  row(i) { return this.tau.subarray(this.nv * i, this.nv * (i + 1)); }

  // tau = M ddq + c + g - J'F of one state; `scale` multiplies dq, its square ddq.
  inverse(i, scales, wrenches, mass, out) {
    const { mechanics, dq, ddq } = this, load = mechanics.carrying(mass);
    return mechanics.run.inverse(this.q[i], scaled(dq[i], scales[0]), scaled(ddq[i], scales[1]), ...wrenches, ...load, out);
  }

  friction(i, tau) { // added to the torques; where a joint stands, its dry friction is not known
    const { viscous } = this.data, { law } = this.mechanics.run, v = scaled(this.dq[i], this.pace);
    if (!viscous) return this.zero;
    const moving = this.still ? v.map((x, k) => (this.still[i][k] ? 0 : x)) : v;
    return law(moving, tau).map((x, k) => x + viscous[k] * (v[k] - moving[k]));
  }

  sweep(mass, out) {
    const { mechanics, nv, time, pace } = this, scales = [pace, pace * pace];
    for (let i = 0; i < time.length; i++) {
      const row = out.subarray(nv * i, nv * (i + 1));
      this.inverse(i, scales, mechanics.wrenches(this.q[i]), mass, row);
      if (this.data.viscous) { const lost = this.friction(i, row); for (let k = 0; k < nv; k++) row[k] += lost[k]; }
    }
    return out;
  }

  run() { // anew, after a change of what is on the robot or of its speed
    const { nv, tau } = this;
    this.sweep(this.mechanics.mass, tau);
    this.peaks = Array.from({ length: nv }, () => ({ value: 0, row: 0 }));
    for (let j = 0; j < tau.length; j++) {
      const peak = this.peaks[j % nv];
      if (Math.abs(tau[j]) > Math.abs(peak.value) || j < nv) Object.assign(peak, { value: tau[j], row: Math.floor(j / nv) });
    }
  }

  // The causes of a torque, by name; they add up to it.
  terms(i, k) {
    const { mechanics, pace } = this, still = mechanics.still, on = mechanics.wrenches(this.q[i]), { gravity } = mechanics.run;
    const at = (v, a, wrenches, mass) => Array.from(this.inverse(i, [v, a], wrenches, mass))[k];
    const rest = at(0, 0, still, 0), alone = at(pace, pace * pace, still, 0), weight = gravity ? gravity(this.q[i])[k] : rest;
    const payload = at(pace, pace * pace, still, mechanics.mass) - alone, carried = this.inverse(i, [pace, pace * pace], on, mechanics.mass);
    return {
      inertia: at(0, pace * pace, still, 0) - rest, coriolis: at(pace, 0, still, 0) - rest, gravity: weight, spring: rest - weight,
      payload, wrench: at(0, 0, on, 0) - rest, friction: this.friction(i, carried)[k],
    };
  }

  get perKilogram() { // of payload, the torques that it takes at this speed, by rows; a push does not change them
    if (this.known?.pace !== this.pace) {
      const { tau, nv, pace, mechanics } = this, scales = [pace, pace * pace], found = new Float64Array(tau.length), alone = new Float64Array(nv);
      for (let i = 0; i < this.time.length; i++) {
        const row = this.inverse(i, scales, mechanics.still, 1, found.subarray(nv * i, nv * (i + 1)));
        this.inverse(i, scales, mechanics.still, 0, alone);
        for (let k = 0; k < nv; k++) row[k] -= alone[k];
      }
      this.known = { pace, found };
    }
    return this.known.found;
  }

  // The largest payload, where each torque is linear in it: m <= (+-limit - tau_0) / tau_1 in every row of every joint.
  margin(loaded, least) {
    const { limits, nv, tau, perKilogram } = this, { mass } = this.mechanics, most = new Float64Array(nv);
    let found = { mass: Infinity };
    for (let j = 0; j < tau.length; j++) {
      const k = j % nv, per = perKilogram[j], alone = tau[j] - mass * per;
      if (Math.abs(alone) > limits[k]) return null;
      most[k] = Math.max(most[k], Math.abs(per));
      if (!(Math.abs(per) > least)) continue;
      const allowed = (Math.sign(per) * limits[k] - alone) / per;
      if (allowed < found.mass) found = { mass: allowed, joint: k, row: Math.floor(j / nv) };
    }
    return found.mass === Infinity || loaded(most).some((on, k) => on && limits[k] === Infinity) ? null : found;
  }
}

const scaled = (row, s) => (s === 1 ? row : row.map((x) => s * x));
