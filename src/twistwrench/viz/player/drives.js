// Drives that hold a pose as far as their limits allow: tau = clip(gravity + K e - D dq, +-limit).
"use strict";

const GIVES = 0.1; // rad, m: off the pose by which a drive gives its limit
const QUICKEST = 100; // rad/s, of a joint alone on its drive
const DRIVE_RATIO = 0.7; // of damping

class Drives {
  constructor(mechanics, pose) {
    const { robot } = mechanics, n = robot.torques.length, M = mechanics.massMatrix(pose);
    Object.assign(this, { mechanics, pose: pose.slice() });
    this.joints = robot.hands.filter(({ v, turn: turns }) => v.length === 1 && turns === undefined).map(({ q, v: [k] }) => {
      const { limit } = robot.torques[k], own = M[(n + 1) * k], stiffness = Math.min(limit / GIVES, own * QUICKEST ** 2);
      return { q, k, limit, stiffness, damping: 2 * DRIVE_RATIO * Math.sqrt(stiffness * own) };
    });
  }

  torques(q, v) {
    const needed = this.mechanics.holding(q, this.mechanics.wrenches(q)), tau = new Array(v.length).fill(0);
    for (const { q: at, k, limit, stiffness, damping } of this.joints) tau[k] = Math.min(limit, Math.max(-limit, needed[k] + stiffness * (this.pose[at] - q[at]) - damping * v[k]));
    return tau;
  }

  slipping(q, pull = null) { // joints that need more than they have to stand still: {k, needs, limit}
    const needed = Array.from(this.mechanics.holding(q, this.mechanics.wrenches(q)), (x, k) => x - (pull ? pull[k] : 0));
    return this.joints.flatMap(({ k, limit }) => (isOver(needed[k] / limit) ? [{ k, needs: needed[k], limit }] : []));
  }
}
