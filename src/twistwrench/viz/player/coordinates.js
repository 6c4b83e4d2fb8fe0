// Coordinates: quaternions as the angles of sliders, and what lies between two samples.
"use strict";

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
