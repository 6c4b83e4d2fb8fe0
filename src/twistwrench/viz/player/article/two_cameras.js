// One scene seen by cameras that stand in the room or sit on the body, drawn with a pen: solids, arrows with their letters, trails.
// Each thing of a scene is in coordinates of the room; a view's frame R, by rows, turns them into its own.
"use strict";

const MOST_PIXELS = 2; // for one of the page's
const AROUND = 16; // points of a cone's rim
const TURNS = [0, 1, -1, 2, -2, 3, -3, 4].map((k) => (k * Math.PI) / 4); // of a letter round its place

class View extends Orbit {
  constructor(canvas, size, { azimuth = -0.9, elevation = 0.35 } = {}) {
    super(canvas, size);
    Object.assign(this.home, { azimuth, elevation });
    Object.assign(this, this.home);
    this.pen = canvas.getContext("2d");
    this.visit(true);
    this.heads = []; // of arrows as drawn: {name, from, to} in pixels
  }

  draw(things, colours, frame = UPRIGHT, lit = null) {
    const { canvas, pen } = this, ratio = Math.min(window.devicePixelRatio || 1, MOST_PIXELS);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.round(x * ratio));
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const { camera, eye } = this.camera();
    Object.assign(this, { colours, lit, eye, heads: [], letters: [] });
    this.onScreen = (point) => {
      const p = rotatedBack(frame, point), [x, y, , w] = [0, 1, 2, 3].map((i) => dot(camera.slice(4 * i, 4 * i + 3), p) + camera[4 * i + 3]);
      return [((x / w + 1) / 2) * canvas.clientWidth, ((1 - y / w) / 2) * canvas.clientHeight];
    };
    this.depth = (point) => norm(add(rotatedBack(frame, point), times(-1, eye)));
    this.facing = (normal, point) => dot(rotatedBack(frame, normal), add(eye, times(-1, rotatedBack(frame, point)))) > 0;
    this.light = (normal) => { const n = rotatedBack(frame, normal); return 0.8 + 0.16 * n[2] + 0.18 * Math.max(0, dot(n, unit([0.35, -0.45, 0.85]))); };
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    const of = (...kinds) => things.filter(({ kind }) => kinds.includes(kind)), far = (a, b) => this.depth(b.middle) - this.depth(a.middle);
    of("floor").forEach((each) => this.stroke(each));
    of("solid").flatMap(({ faces }) => faces).sort(far).forEach((face) => this.face(face));
    of("area").forEach((each) => this.area(each));
    of("line", "trail").forEach((each) => this.stroke(each));
    const arrows = of("arrow").map((each) => ({ ...each, middle: times(0.5, add(each.from, each.to)) })).sort(far);
    arrows.forEach((each) => this.arrow(each));
    of("arc").forEach((each) => this.arc(each));
    this.rings = of("handle").map((each) => this.ring(each));
    for (const each of [...of("note"), ...arrows, ...of("dot", "arc")]) this.letter(each);
  }

  shade(name) { return this.lit && name && this.lit !== name ? 0.22 : 1; }

  path(points, closed = false) {
    const { pen } = this;
    pen.beginPath();
    points.forEach((point, k) => pen[k ? "lineTo" : "moveTo"](...this.onScreen(point)));
    if (closed) pen.closePath();
  }

  face({ corners, normal, middle, colour }) {
    const { pen, colours } = this, [r, g, b] = colour ?? colours.solid, light = this.light(normal) + (this.facing(normal, middle) ? 0 : -0.1);
    this.path(corners, true);
    pen.globalAlpha = colours.opacity;
    pen.fillStyle = `rgb(${[r, g, b].map((x) => Math.min(255, Math.round(x * light)))})`;
    pen.fill();
    pen.globalAlpha = 0.8;
    Object.assign(pen, { strokeStyle: colours.edge, lineWidth: 1, lineJoin: "round" });
    pen.stroke();
    pen.globalAlpha = 1;
  }

  area({ corners, name }) {
    this.path(corners, true);
    this.pen.globalAlpha = 0.18 * this.shade(name);
    this.pen.fillStyle = this.colours[name];
    this.pen.fill();
    this.stroke({ points: [...corners, corners[0]], name, width: 1 });
  }

  stroke({ kind, points, name = "line", width = 1.5, dashed = false, rim = false }) {
    const { pen, colours } = this;
    if (rim) this.stroke({ points, name: "paper", width: width + 4 });
    Object.assign(pen, { strokeStyle: colours[name], lineWidth: width, lineCap: kind === "trail" ? "butt" : "round", lineJoin: "round" });
    pen.setLineDash(dashed ? [5, 5] : []);
    if (kind !== "trail") {
      pen.globalAlpha = this.shade(name === "line" ? null : name);
      this.path(points);
      pen.stroke();
    } else // fades towards its beginning, in pieces
      for (let k = 0; k + 1 < points.length; k += 4) {
        pen.globalAlpha = 0.65 * this.shade(name) * ((k + 4) / points.length) ** 1.5;
        this.path(points.slice(k, k + 5));
        pen.stroke();
      }
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  arrow({ from, to, name, width = 4, dashed = false }) {
    const way = add(to, times(-1, from)), length = norm(way);
    if (length < 1e-6 * this.size) return;
    const { pen, colours } = this, x = times(1 / length, way), head = Math.min(0.55 * length, 0.0175 * width * this.size);
    const neck = add(from, times(length - head, x)), y = unit(cross(Math.abs(x[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0], x)), z = cross(x, y), radius = 0.4 * head;
    const rim = Array.from({ length: AROUND }, (_, k) => {
      const angle = (2 * Math.PI * k) / AROUND;
      return add(neck, add(times(radius * Math.cos(angle), y), times(radius * Math.sin(angle), z)));
    });
    const cone = hull([...rim, to].map((point) => this.onScreen(point)));
    pen.globalAlpha = (dashed ? 0.75 : 1) * this.shade(name);
    for (const [colour, more] of [[colours.paper, 3], [colours[name], 0]]) { // with a rim of the background's colour
      Object.assign(pen, { strokeStyle: colour, fillStyle: colour, lineWidth: width + more, lineCap: "round", lineJoin: "round" });
      pen.setLineDash(dashed && !more ? [7, 7] : []);
      this.path([from, neck]);
      pen.stroke();
      pen.setLineDash([]);
      pen.beginPath();
      cone.forEach((point, k) => pen[k ? "lineTo" : "moveTo"](...point));
      pen.closePath();
      pen.fill();
      if (more) { pen.lineWidth = more; pen.stroke(); }
    }
    pen.globalAlpha = 1;
    this.heads.push({ name, from: this.onScreen(from), to: this.onScreen(to) });
  }

  arc({ middle, radius, sweep, name }) { // about z, from the x axis
    const steps = Math.max(3, Math.ceil(Math.abs(sweep) / 0.15)), neck = sweep * 0.86;
    const at = (angle, r = radius) => add(middle, [r * Math.cos(angle), r * Math.sin(angle), 0]);
    this.stroke({ points: Array.from({ length: steps + 1 }, (_, k) => at((neck * k) / steps)), name, width: 3.5 });
    const { pen, colours } = this;
    pen.globalAlpha = this.shade(name);
    pen.fillStyle = colours[name];
    this.path([at(neck, 0.82 * radius), at(sweep), at(neck, 1.18 * radius)], true);
    pen.fill();
    pen.globalAlpha = 1;
  }

  ring({ at, name }) { // what can be dragged
    const { pen } = this, middle = this.onScreen(at);
    pen.beginPath();
    pen.arc(...middle, 15, 0, 2 * Math.PI);
    pen.globalAlpha = 0.6;
    Object.assign(pen, { strokeStyle: this.colours[name], lineWidth: 1.5 });
    pen.stroke();
    pen.globalAlpha = 1;
    return middle;
  }

  // The letter of a thing: at the end of an arrow or a share `along` it, or beside that, to its left or (-1) right; towards [dx, dy] from
  // another thing; a note has no dot. Where another letter stands, it goes round to the nearest free place.
  letter({ kind, from, to, along = 1, middle, radius, at, label, name = "line", beside = false, below = false, towards = below ? [0, 1] : [-1, -1] }) {
    const { pen, colours } = this, end = this.onScreen(kind === "arrow" ? add(times(1 - along, from), times(along, to)) : at ?? add(middle, [radius, 0, 0]));
    const start = kind === "arrow" ? this.onScreen(from) : add(end, kind === "arc" ? [-1, 1] : times(-1, towards)), side = Number(beside);
    if (kind === "dot") { pen.beginPath(); pen.arc(...end, 4, 0, 2 * Math.PI); pen.fillStyle = colours[name]; pen.fill(); }
    if (!label) return;
    Object.assign(pen, { font: '600 17px "STIX Two Math", "Cambria Math", "DejaVu Sans", sans-serif', textAlign: "center", textBaseline: "middle", lineWidth: 4, lineJoin: "round", strokeStyle: colours.paper, fillStyle: colours[name] });
    const half = pen.measureText(label).width / 2, { clientWidth, clientHeight } = this.canvas, within = (a, least, most) => Math.min(most - least, Math.max(least, a));
    const [u, v] = add(end, times(-1, start)), first = Math.atan2(v, u) - (side * Math.PI) / 2, gap = this.rings.some((ring) => Math.hypot(...add(ring, times(-1, end))) < 4) ? 18 : 7;
    const places = (kind === "note" ? [end] : TURNS.map((turn) => [Math.cos(first + turn), Math.sin(first + turn)]).map(([c, s]) => add(end, times(gap + half * Math.abs(c) + 9 * Math.abs(s), [c, s])))).map(([x, y]) => [within(x, half + 3, clientWidth), within(y, 11, clientHeight)]);
    const [x, y] = places.find(([x, y]) => this.letters.every((other) => Math.abs(x - other.x) > half + other.half + 4 || Math.abs(y - other.y) > 18)) ?? places[0];
    this.letters.push({ x, y, half });
    pen.globalAlpha = this.shade(name);
    pen.strokeText(label, x, y);
    pen.fillText(label, x, y);
    pen.globalAlpha = 1;
  }

  // Name of the arrow at a place of the canvas, or null.
  arrowAt(x, y, most = 12) {
    const far = ({ from, to }) => {
      const way = add(to, times(-1, from)), along = Math.min(1, Math.max(0, inner(add([x, y], times(-1, from)), way) / (inner(way, way) || 1)));
      return Math.hypot(...add(add(from, times(along, way)), [-x, -y]));
    };
    const nearest = [...this.heads].sort((a, b) => far(a) - far(b))[0];
    return nearest && far(nearest) < most ? nearest.name : null;
  }
}

// Convex hull of points in the plane, counterclockwise.
function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const left = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]) > 0;
  const chain = (list) => {
    const found = [];
    for (const p of list) {
      while (found.length > 1 && !left(found[found.length - 2], found[found.length - 1], p)) found.pop();
      found.push(p);
    }
    return found.slice(0, -1);
  };
  return [...chain(sorted), ...chain(sorted.reverse())];
}
