// Any link, pulled by a spring between the pointer and the point that was taken hold of.
"use strict";

const STRETCHED = 1 / 3; // of the height of the view: there the spring pulls with the robot's weight
const SPRING_RATIO = 0.7; // of damping, for a tenth of the moving mass
const SLOPE = 1e-3; // rad, m: by which a coordinate is changed, by four places, for the slope of a point

class Grab {
  constructor(viewer) {
    Object.assign(this, { viewer, held: null });
    this.can = viewer.robot.fall.spheres.length > 0;
    if (this.can) viewer.stage.seize = (x, y) => this.take(x, y);
  }

  // The nearest link under a place of the canvas, {body, p}, by the spheres around links; null where there is none.
  under(x, y) {
    const { stage, robot, poses } = this.viewer, [eye, way] = stage.ray(x, y);
    let found = null;
    for (const { body, middle, radius } of robot.fall.spheres) {
      const T = poses[body], centre = add(place(T), turn(T, middle)), from = add(centre, times(-1, eye)), along = dot(from, way), off = dot(from, from) - along * along;
      if (off > radius * radius || along <= 0) continue;
      const far = along - Math.sqrt(radius * radius - off);
      if (!found || far < found.far) found = { body, far, p: add(eye, times(far, way)) };
    }
    return found;
  }

  take(x, y) { // null, or what pulls by pixels along the screen
    const { viewer } = this, { stage, robot } = viewer, found = this.under(x, y);
    if (!found) return null;
    const T = viewer.poses[found.body], weight = 9.81 * robot.moving, k = weight / (STRETCHED * 2 * Math.tan(0.3) * found.far);
    this.held = { body: found.body, point: turnedBack(T, add(found.p, times(-1, place(T)))), target: found.p, k, d: 2 * SPRING_RATIO * Math.sqrt(0.1 * robot.moving * k) };
    const move = (dx, dy) => {
      const { right, up } = stage.camera(), metre = stage.metre(this.held.target);
      this.held.target = add(this.held.target, add(times(dx / metre, right), times(-dy / metre, up)));
      this.pulled();
    };
    move.end = () => { this.held = null; this.pulled(); };
    this.pulled();
    return move;
  }

  pulled() { // a robot at rest moves again
    const { viewer } = this;
    if (viewer.fall) viewer.fall.calm = 0;
    viewer.refresh();
  }

  at(q) { const { body, point } = this.held, T = this.viewer.mechanics.poses(q)[body]; return add(place(T), turn(T, point)); }

  // Columns of the point's Jacobian in the base's axes, by differences of fourth order.
  columns(q) {
    const { run } = this.viewer.mechanics, n = this.viewer.robot.torques.length, v = new Float64Array(n);
    return Array.from(v, (_, k) => {
      v.fill(0);
      v[k] = 1;
      const rates = run.rates(q, v), moved = (s) => this.at(Array.from(q, (x, i) => x + s * rates[i]));
      return times(1 / (12 * SLOPE), add(times(8, add(moved(SLOPE), times(-1, moved(-SLOPE)))), times(-1, add(moved(2 * SLOPE), times(-1, moved(-2 * SLOPE))))));
    });
  }

  // Force of the spring on the robot [N], and what it does at the joints, J' f.
  force(q, v = null, columns = null) {
    const { target, k, d } = this.held, pull = times(k, add(target, times(-1, this.at(q))));
    return v ? add(pull, times(-d, columns.map((column, i) => times(v[i], column)).reduce(add))) : pull;
  }

  torques(q, v = null) {
    const columns = this.columns(q), f = this.force(q, v, columns);
    return columns.map((column) => dot(column, f));
  }

  marks(items) { // the spring, from the point to the pointer
    const { viewer, held } = this, place_ = document.getElementById("pull");
    place_.hidden = !held;
    if (!held) return;
    const p = this.at(viewer.q), way = add(held.target, times(-1, p)), size = viewer.robot.size, [x, y] = viewer.stage.project(held.target);
    Object.assign(place_, { textContent: `${number(norm(this.force(viewer.q)), 3)} N` });
    place_.style.transform = `translate(${x + 14}px, ${y + 4}px)`;
    const thin = [0.006 * size, 0, 0, 0, 0, 0.006 * size, 0, 0, 0, 0, norm(way), 0, 0, 0, 0, 1], colour = [...viewer.robot.colours.polytope, 1];
    if (norm(way) > 1e-6) items.push({ kept: viewer.cached("column", column), model: mul(mul(shifted(p), alongZ(way)), thin), colour, over: true });
    items.push({ kept: viewer.cached("knob", () => ball(8)), model: mul(shifted(p), scaling(0.012 * size)), colour, over: true });
  }
}
