// The tip, held by the mouse: joints follow it by damped least squares, within their limits.
"use strict";

class Grasp {
  constructor(viewer) {
    this.viewer = viewer;
    const { robot, mechanics } = viewer;
    this.can = mechanics.run.jacobian !== undefined && mechanics.run.rates !== undefined && mechanics.pushed >= 0
      && robot.hands.every(({ turn: turns }) => turns === undefined); // a base that floats would come along
    if (!this.can) return;
    viewer.stage.grasp = (x, y, near) => this.hold(x, y, near);
    this.ends = new Map(robot.hands.map((hand) => [hand.q, [hand.least ?? -Infinity, hand.most ?? Infinity]]));
  }

  get tip() { return place(this.viewer.mechanics.tipPose(this.viewer.q)); }

  hold(x, y, near) { // null, or what moves the tip by pixels along the screen
    const { stage } = this.viewer, [a, b] = stage.project(this.tip);
    if (Math.hypot(a - x, b - y) > near) return null;
    let wanted = this.tip;
    return (dx, dy) => {
      this.moved = true;
      const { right, up } = stage.camera(), p = this.tip, step = 1e-3 * stage.size, [u, v] = stage.project(p);
      const scale = step / Math.hypot(...stage.project(add(p, times(step, right))).map((z, k) => z - [u, v][k]));
      wanted = add(wanted, add(times(dx * scale, right), times(-dy * scale, up)));
      this.reach(wanted);
    };
  }

  reach(wanted) {
    const { robot, mechanics } = this.viewer, longest = 0.1 * robot.size;
    let q = this.viewer.q;
    for (let turn_ = 0; turn_ < 8; turn_++) {
      const off = add(wanted, times(-1, place(mechanics.tipPose(q)))), far = norm(off);
      if (far < 1e-6 * robot.size) break;
      const v = dampedStep(mechanics.tipColumns(q), times(Math.min(1, longest / far), off), 1e-3 * robot.size ** 2);
      const rates = mechanics.run.rates(q, v);
      q = q.map((x, k) => { const [least, most] = this.ends.get(k) || [-Infinity, Infinity]; return Math.min(most, Math.max(least, x + rates[k])); });
    }
    this.viewer.setCoordinates(q);
  }
}

function dampedStep(columns, off, damping) { // v = J' (J J' + damping 1)^-1 off. MR section 6.2.2
  const A = [damping, 0, 0, 0, damping, 0, 0, 0, damping];
  columns.forEach((c) => { for (let k = 0; k < 9; k++) A[k] += c[Math.floor(k / 3)] * c[k % 3]; });
  const rows = [A.slice(0, 3), A.slice(3, 6), A.slice(6)], det = dot(rows[0], cross(rows[1], rows[2]));
  const y = [0, 1, 2].map((k) => dot(cross(rows[(k + 1) % 3], rows[(k + 2) % 3]), off) / det); // A is symmetric
  return columns.map((c) => dot(c, y));
}
