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
    this.followers = data.verdict.followers; // mimic joints with limits of their own
    this.borne = new Float64Array(this.followers.length * this.time.length); // their torques, without friction
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

  across(mass, wrenches, out) { // what mimic joints bear: S'F of the wrench across each
    const { mechanics, followers, pace } = this, load = mechanics.carrying(mass);
    if (followers.length) this.q.forEach((q, i) => {
      const F = mechanics.run.across(q, scaled(this.dq[i], pace), scaled(this.ddq[i], pace * pace), ...wrenches(q), ...load);
      followers.forEach(({ body, axis }, k) => { out[followers.length * i + k] = inner(axis, F.subarray(6 * body, 6 * body + 6)); });
    });
    return out;
  }

  run() { // anew, after a change of what is on the robot or of its speed
    const { mechanics } = this;
    this.peaks = peaksOf(this.sweep(mechanics.mass, this.tau), this.nv);
    this.most = peaksOf(this.across(mechanics.mass, (q) => mechanics.wrenches(q), this.borne), this.followers.length);
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
    if (this.known?.pace !== this.pace || this.known.tip !== this.mechanics.robot.tip) {
      const { tau, nv, pace, mechanics } = this, scales = [pace, pace * pace], found = new Float64Array(tau.length), alone = new Float64Array(nv);
      for (let i = 0; i < this.time.length; i++) {
        const row = this.inverse(i, scales, mechanics.still, 1, found.subarray(nv * i, nv * (i + 1)));
        this.inverse(i, scales, mechanics.still, 0, alone);
        for (let k = 0; k < nv; k++) row[k] -= alone[k];
      }
      const borne = this.across(1, () => mechanics.still, this.borne.slice()), none = this.across(0, () => mechanics.still, this.borne.slice());
      this.known = { pace, tip: mechanics.robot.tip, found, borne: borne.map((x, j) => x - none[j]) };
    }
    return this.known;
  }

  // The largest payload, where each torque is linear in it: m <= (+-limit - tau_0) / tau_1 in every row of every joint.
  margin(loaded, least) {
    const { limits, nv, tau, perKilogram, followers, borne } = this, { mass } = this.mechanics, most = new Float64Array(nv);
    let found = { mass: Infinity };
    for (const [values, each, ends, first] of [[tau, perKilogram.found, limits, 0], [borne, perKilogram.borne, followers.map(({ limit }) => limit), nv]])
      for (let j = 0; j < values.length; j++) {
        const k = j % ends.length, per = each[j], alone = values[j] - mass * per;
        if (Math.abs(alone) > ends[k]) return null;
        if (!first) most[k] = Math.max(most[k], Math.abs(per));
        if (!(Math.abs(per) > least)) continue;
        const allowed = (Math.sign(per) * ends[k] - alone) / per;
        if (allowed < found.mass) found = { mass: allowed, joint: first + k, row: Math.floor(j / ends.length) };
      }
    return found.mass === Infinity || loaded(most).some((on, k) => on && limits[k] === Infinity) ? null : found;
  }
}

function peaksOf(values, n) { // the largest magnitude of each column, with its sign and row
  const peaks = Array.from({ length: n }, () => ({ value: 0, row: 0 }));
  values.forEach((x, j) => { const peak = peaks[j % n]; if (Math.abs(x) > Math.abs(peak.value) || j < n) Object.assign(peak, { value: x, row: Math.floor(j / n) }); });
  return peaks;
}

const scaled = (row, s) => (s === 1 ? row : row.map((x) => s * x));
