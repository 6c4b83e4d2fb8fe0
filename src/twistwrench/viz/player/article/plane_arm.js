// A planar arm with two links of 1 m in the plane x, y: where its joints are, and how it is drawn.
"use strict";

const LINK = 1, ORIGIN = [0, 0, 0];

function placesOf([a, b]) { // of joint 2 and tip, and from the one to the other
  const elbow = [LINK * Math.cos(a), LINK * Math.sin(a), 0], fore = [LINK * Math.cos(a + b), LINK * Math.sin(a + b), 0];
  return { elbow, fore, tip: add(elbow, fore) };
}

function armBody(angles) { // links and joints
  const { elbow, tip } = placesOf(angles), [a, b] = angles, link = (from, to, angle) => solid(boxFaces([LINK / 2, 0.045, 0.03]), turnAbout([0, 0, 1], angle), times(0.5, add(from, to)));
  return [link(ORIGIN, elbow, a), link(elbow, tip, a + b), ...[ORIGIN, elbow].map((p) => solid(cylinderFaces(0.09, 0.05), UPRIGHT, p))];
}

// Dashed line of a force through a point, and the levers from places to it, each with its letter and a right angle at its foot.
// A lever may be drawn at a shift along the line, beside a link that would hide it.
function leversTo(places, point, way, [behind, ahead] = [2.6, 2.6], { letters = [], shifts = [] } = {}) {
  const foot = (p) => add(p, add(add(point, times(-1, p)), times(-dot(add(point, times(-1, p)), way), way)));
  const line = { kind: "line", name: "wrench", width: 1.5, dashed: true, label: "line of force", points: [add(point, times(-behind, way)), add(point, times(ahead, way))] };
  const lever = (p, k) => {
    const shift = times(shifts[k] ?? 0, way), [from, to] = [add(p, shift), add(foot(p), shift)], long = norm(add(to, times(-1, from)));
    if (long < 0.02) return [];
    const back = times(-0.08 / long, add(to, times(-1, from))), side = times(0.08, way), thin = { kind: "line", name: "change", label: "lever" };
    return [
      { ...thin, width: 3, rim: true, points: [from, to] }, { ...thin, width: 1.5, points: [add(to, back), add(to, add(back, side)), add(to, side)] },
      ...(letters[k] ? [{ kind: "note", name: "change", at: add(times(0.5, add(from, to)), times(0.11, way)), label: letters[k] }] : []),
    ];
  };
  return [line, ...places.flatMap(lever)];
}

const momentAbout = (p, at, f) => cross(add(at, times(-1, p)), f)[2]; // of a force in the plane
