// The tip, held by the mouse: joints follow it by damped least squares, within their limits.
"use strict";

class Grasp {
  constructor(viewer) {
    this.viewer = viewer;
    const { robot } = viewer, { run } = viewer.mechanics;
    this.can = run.jacobian0 !== undefined && run.rates !== undefined && robot.tip !== null;
    if (!this.can) return;
    viewer.stage.grasp = (x, y, near) => this.hold(x, y, near);
    this.ends = new Map(robot.hands.map((hand) => [hand.q, [hand.least ?? -Infinity, hand.most ?? Infinity, hand.v]]));
  }

  get tip() { return place(this.viewer.mechanics.tipPose(this.viewer.q)); }

  hold(x, y, near) { // null, or what moves the tip by pixels along the screen
    const { stage, mechanics, q } = this.viewer, [a, b] = stage.project(this.tip), held = mechanics.tipPose(q);
    if (Math.hypot(a - x, b - y) > near) return null;
    let wanted = this.tip;
    return (dx, dy) => {
      this.moved = true;
      const { right, up } = stage.camera(), p = this.tip, step = 1e-3 * stage.size, [u, v] = stage.project(p);
      const scale = step / Math.hypot(...stage.project(add(p, times(step, right))).map((z, k) => z - [u, v][k]));
      wanted = add(wanted, add(times(dx * scale, right), times(-dy * scale, up)));
      this.reach(wanted, held);
    };
  }

  moves(k) { // a base stays, and feet on the floor
    const { robot, loops } = this.viewer;
    return (robot.torques[k].driven || Boolean(loops?.actuated)) && !loops?.legs[k];
  }

  // Moves the tip to a point, and where its orientation is kept, turns it back to that of the pose `held`.
  reach(wanted, held) {
    const { robot, mechanics, shown, holds } = this.viewer, { size } = robot;
    let q = this.viewer.q;
    for (let turn_ = 0; turn_ < 8; turn_++) {
      const rows = tipError(mechanics.tipPose(q), wanted, shown.keep ? held : null, TURN * size), far = Math.hypot(...rows);
      if (far < 1e-6 * size) break;
      const columns = mechanics.tipColumns(q, shown.keep ? TURN * size : 0);
      if (holds) {
        const next = this.along(q, columns, times(Math.min(1, (0.1 * size) / far), rows), damping(far, size));
        if (!next) break;
        q = next;
        continue;
      }
      const v = dampedStep(columns.map((column, k) => (this.moves(k) ? column : times(0, column))), times(Math.min(1, (0.1 * size) / far), rows), damping(far, size));
      const rates = mechanics.run.rates(q, v);
      q = q.map((x, k) => { const [least, most] = this.ends.get(k) || [-Infinity, Infinity]; return Math.min(most, Math.max(least, x + rates[k])); });
    }
    this.viewer.setCoordinates(q);
  }

  // A step of the tip with loops closed: v = N z, A N = 0, up to where the first joint reaches its limit; null where there is none.
  along(q, columns, off, extra) {
    const { loops, mechanics: { run } } = this.viewer, n = columns.length, A = loops.jacobian(q), still = columns.map((_, k) => !this.moves(k));
    for (let turn_ = 0; turn_ < n; turn_++) {
      const fixed = still.flatMap((yes, k) => (yes ? [columns.map((_, i) => Number(i === k))] : [])), N = nullSpace([...A, ...fixed], n);
      if (!N.length) return null;
      const z = dampedStep(N.map((b) => b.map((x, k) => times(x, columns[k])).reduce(add)), off, extra), v = N.map((b, j) => times(z[j], b)).reduce(add);
      const rates = run.rates(q, v), [share, at] = this.room(q, rates);
      if (share < 1e-3) { at.forEach((k) => { still[k] = true; }); continue; }
      const tried = loops.moved(q, times(share, v)), found = loops.closed(tried, still.map((yes) => !yes));
      return found && found.every((x, k) => Math.abs(x - tried[k]) < LEAP) ? found : null;
    }
    return null;
  }

  room(q, rates) { // the share of a step, up to 1, after which the first joint is at a limit, and its velocities
    let found = [1, []];
    for (const [k, [least, most, v]] of this.ends) {
      const share = rates[k] > 0 ? (most - q[k]) / rates[k] : rates[k] < 0 ? (least - q[k]) / rates[k] : 1;
      if (share < found[0]) found = [Math.max(0, share), v];
    }
    return found;
  }
}

const TURN = 0.5; // of the robot's size: the length at which a turn of the tip counts as a move

// How far the tip is from a point (3), and before that, from the orientation of the pose `held`: half the sum of the crosses of
// the axes, times a length; to first order the angle.
function tipError(T, wanted, held, length) {
  const off = add(wanted, times(-1, place(T)));
  if (!held) return off;
  const axis = (pose_, j) => [pose_[j], pose_[4 + j], pose_[8 + j]];
  const turned = [0, 1, 2].map((j) => cross(axis(T, j), axis(held, j))).reduce(add);
  return [...times(0.5 * length, turned), ...off];
}

const damping = (far, size) => size ** 2 * (1e-3 * Math.min(1, far / (0.05 * size)) + 1e-6); // less where the tip is near its goal

function dampedStep(columns, off, extra) { // v = J' (J J' + extra 1)^-1 off. MR section 6.2.2
  const n = off.length, A = new Float64Array(n * n);
  for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) A[n * i + j] = columns.reduce((sum, c) => sum + c[i] * c[j], i === j ? extra : 0);
  const L = cholesky(A, n), y = raised(L, lowered(L, off));
  return columns.map((c) => inner(c, y));
}
