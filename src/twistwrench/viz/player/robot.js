// The robot's kinematics and statics, from the numbers in the page. Matrices 4x4 are arrays of 16, by rows; vectors arrays.
"use strict";

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const add = (a, b) => a.map((x, k) => x + b[k]);
const times = (s, a) => a.map((x) => s * x);
const norm = (a) => Math.sqrt(dot(a, a));
const unit = (a) => times(1 / (norm(a) || 1), a);
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

function mul(A, B) {
  const C = new Array(16).fill(0);
  for (let i = 0; i < 4; i++)
    for (let j = 0; j < 4; j++) for (let k = 0; k < 4; k++) C[4 * i + j] += A[4 * i + k] * B[4 * k + j];
  return C;
}
const turn = (T, a) => [0, 1, 2].map((i) => T[4 * i] * a[0] + T[4 * i + 1] * a[1] + T[4 * i + 2] * a[2]);
const place = (T) => [T[3], T[7], T[11]];
const move = (T, a) => add(turn(T, a), place(T));
const pose = (R, p) => [R[0], R[1], R[2], p[0], R[3], R[4], R[5], p[1], R[6], R[7], R[8], p[2], 0, 0, 0, 1];

function rotation(w, angle) { // Rodrigues' formula about a unit vector, MR eq. 3.51
  const [x, y, z] = w, s = Math.sin(angle), c = Math.cos(angle), d = 1 - c;
  return [c + d * x * x, d * x * y - s * z, d * x * z + s * y, d * x * y + s * z, c + d * y * y, d * y * z - s * x,
    d * x * z - s * y, d * y * z + s * x, c + d * z * z];
}

function screwMotion(S, theta) { // exp([S] theta), MR eq. 3.88
  const rate = norm(S.slice(0, 3));
  if (rate === 0) return pose([1, 0, 0, 0, 1, 0, 0, 0, 1], times(theta, S.slice(3)));
  const w = times(1 / rate, S.slice(0, 3)), v = times(1 / rate, S.slice(3)), angle = rate * theta;
  const wv = cross(w, v), wwv = cross(w, wv);
  const p = add(add(times(-Math.sin(angle), wwv), times(1 - Math.cos(angle), wv)), times(angle * dot(w, v), w));
  return pose(rotation(w, angle), p);
}

function fromQuaternion(q) {
  const n = Math.hypot(...q) || 1, [w, x, y, z] = q.map((c) => c / n);
  return [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z), 1 - 2 * (x * x + z * z),
    2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)];
}

function toQuaternion(roll, pitch, yaw) {
  const [a, b, c] = [roll / 2, pitch / 2, yaw / 2];
  const [ca, sa, cb, sb, cc, sc] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b), Math.cos(c), Math.sin(c)];
  return [ca * cb * cc + sa * sb * sc, sa * cb * cc - ca * sb * sc, ca * sb * cc + sa * cb * sc, ca * cb * sc - sa * sb * cc];
}

function jointPose(body, q) {
  const at = q.slice(body.q, body.q + body.nq);
  if (body.kind === "rotor") return IDENTITY; // looks the same however it has turned
  if (body.kind === "ball") return pose(fromQuaternion(at), [0, 0, 0]);
  if (body.kind === "floating") return pose(fromQuaternion(at.slice(0, 4)), at.slice(4));
  if (body.kind === "planar") {
    const [turning, first, second] = body.axes;
    return pose(rotation(turning.slice(0, 3), at[2]), add(times(at[0], first.slice(3)), times(at[1], second.slice(3))));
  }
  return screwMotion(body.axes[0], body.ratio * at[0] + body.offset);
}

// T_s,body of every body. MR section 4.1.
function bodyPoses(robot, q) {
  const found = [];
  for (const body of robot.bodies) {
    const carried = mul(body.placement, jointPose(body, q));
    found.push(body.parent < 0 ? carried : mul(found[body.parent], carried));
  }
  return found;
}
const poseOf = (poses, body) => (body < 0 ? IDENTITY : poses[body]);

// The screw axes of the joints at the base origin: {v, body, S} for each velocity each body has, times its ratio.
function spaceAxes(robot, poses) {
  const found = [];
  robot.bodies.forEach((body, k) => {
    if (body.kind === "rotor") return;
    body.axes.forEach((axis, i) => {
      const w = times(body.ratio, turn(poses[k], axis.slice(0, 3))), v = times(body.ratio, turn(poses[k], axis.slice(3)));
      found.push({ v: body.v + i, body: k, w, u: add(v, cross(place(poses[k]), w)) });
    });
  });
  return found;
}

// The torques that hold the robot still: gravity, springs, and the wrenches on it. MR section 8.1, dq = ddq = 0.
function holdingTorques(robot, q) {
  const poses = bodyPoses(robot, q);
  const force = robot.bodies.map((b) => times(b.mass, robot.gravity));
  const moment = robot.bodies.map((b, k) => cross(move(poses[k], b.com), force[k]));
  for (const wrench of robot.wrenches) {
    const frame = robot.frames[wrench.frame];
    if (frame.body < 0) continue;
    const T = mul(poses[frame.body], frame.pose), f = turn(T, wrench.force);
    force[frame.body] = add(force[frame.body], f);
    moment[frame.body] = add(moment[frame.body], add(turn(T, wrench.moment), cross(place(T), f)));
  }
  for (let k = robot.bodies.length - 1; k >= 0; k--) { // children come after parents
    const parent = robot.bodies[k].parent;
    if (parent < 0) continue;
    force[parent] = add(force[parent], force[k]);
    moment[parent] = add(moment[parent], moment[k]);
  }
  const tau = new Array(robot.torques.length).fill(0);
  for (const { v, body, w, u } of spaceAxes(robot, poses)) tau[v] -= dot(w, moment[body]) + dot(u, force[body]);
  for (const spring of robot.springs) {
    const stretch = spring.ends.reduce((sum, end) => sum + end.weight * q[end.q], -spring.rest);
    for (const end of spring.ends) tau[end.v] += end.weight * spring.stiffness * stretch;
  }
  return tau;
}

function centreOfMass(robot, poses) {
  let mass = 0, sum = [0, 0, 0];
  robot.bodies.forEach((b, k) => { mass += b.mass; sum = add(sum, times(b.mass, move(poses[k], b.com))); });
  return mass > 0 ? times(1 / mass, sum) : null;
}

// The rows of the Jacobian that move the tip, in the base's axes: a column (3) for each velocity. MR section 5.1.
function tipJacobian(robot, poses) {
  const tip = robot.frames[robot.tip], p = place(mul(poseOf(poses, tip.body), tip.pose));
  const columns = robot.torques.map(() => [0, 0, 0]), above = new Set();
  for (let k = tip.body; k >= 0; k = robot.bodies[k].parent) above.add(k);
  for (const { v, body, w, u } of spaceAxes(robot, poses))
    if (above.has(body)) columns[v] = add(columns[v], add(u, cross(w, p)));
  return { columns, p };
}

// What takes the unit sphere to the forces whose torques, as shares of their limits, have norm 1; null at singular poses.
function forceEllipsoid(robot, columns) { // f' A f = 1 with A = J W^-2 J' = L L', so f = L'^-1 u. MR section 5.4
  const A = new Array(9).fill(0);
  columns.forEach((c, k) => {
    const limit = robot.torques[k].limit;
    if (limit) for (let i = 0; i < 9; i++) A[i] += (c[Math.floor(i / 3)] * c[i % 3]) / limit ** 2;
  });
  const least = 1e-9 * (A[0] + A[4] + A[8]), a = A[0], b = A[3] / Math.sqrt(a), c = A[6] / Math.sqrt(a);
  const d2 = A[4] - b * b, d = Math.sqrt(d2), e = (A[7] - b * c) / d, f2 = A[8] - c * c - e * e;
  if (!(a > least && d2 > least && f2 > least)) return null;
  const l = Math.sqrt(a), f = Math.sqrt(f2);
  return [1 / l, -b / (l * d), (b * e - c * d) / (l * d * f), 0, 1 / d, -e / (d * f), 0, 0, 1 / f];
}

// Every force at the tip, without moment, that keeps torques within their limits at rest: corners, and the facets' corners
// in order; null where it has no end or no inside. MR section 5.2; tau = g + J' f.
function forcePolytope(robot, columns, holding) {
  const sides = [];
  columns.forEach((c, k) => {
    const limit = robot.torques[k].limit, size = norm(c);
    if (!limit || size < 1e-9) return;
    sides.push({ n: times(1 / size, c), b: (limit - holding[k]) / size });
    sides.push({ n: times(-1 / size, c), b: (limit + holding[k]) / size });
  });
  if (sides.length < 6 || sides.length > 48) return null;
  const corners = [];
  for (let i = 0; i < sides.length; i++)
    for (let j = i + 1; j < sides.length; j++)
      for (let k = j + 1; k < sides.length; k++) {
        const [A, B, C] = [sides[i], sides[j], sides[k]], BC = cross(B.n, C.n), det = dot(A.n, BC);
        if (Math.abs(det) < 1e-7) continue;
        const x = times(1 / det, add(times(A.b, BC), add(times(B.b, cross(C.n, A.n)), times(C.b, cross(A.n, B.n)))));
        const slack = 1e-7 * (1 + norm(x));
        if (sides.every((s) => dot(s.n, x) <= s.b + slack) && !corners.some((y) => norm(add(x, times(-1, y))) < 10 * slack))
          corners.push(x);
      }
  if (corners.length < 4) return null;
  const facets = [];
  for (const { n, b } of sides) {
    const on = corners.filter((x) => Math.abs(dot(n, x) - b) < 1e-5 * (1 + Math.abs(b)));
    if (on.length < 3) continue;
    const middle = times(1 / on.length, on.reduce(add)), first = unit(add(on[0], times(-1, middle))), second = cross(n, first);
    const angle = (x) => Math.atan2(dot(add(x, times(-1, middle)), second), dot(add(x, times(-1, middle)), first));
    facets.push(on.sort((x, y) => angle(x) - angle(y)));
  }
  return { corners, facets };
}

// Coordinates between two samples: the short way round for what turns.
function between(robot, a, b, share) {
  const q = a.map((x, k) => x + share * (robot.coordinates[k].turns ? shortest(b[k] - x) : b[k] - x));
  for (const body of robot.bodies)
    if ((body.kind === "floating" || body.kind === "ball") && !body.follows) {
      const here = [0, 1, 2, 3].map((k) => body.q + k), same = here.reduce((sum, k) => sum + a[k] * b[k], 0) < 0 ? -1 : 1;
      for (const k of here) q[k] = (1 - share) * a[k] + share * same * b[k];
    }
  return q;
}
const shortest = (angle) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
