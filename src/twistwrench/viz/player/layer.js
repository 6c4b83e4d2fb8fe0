// A result over the robot: arrows at fixed places, or along the motion, and places coloured by a quantity, with the command's sentence.
"use strict";

const SHORTEST = 0.01, THICKEST = 0.008; // of an arrow that is drawn, as shares of the robot's size
const DOT = 0.01; // radius, likewise

// Octahedra around points, as one surface.
function octahedra(points, radius) {
  const tips = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], sides = [0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5];
  const positions = points.flatMap((p) => tips.flatMap((tip) => add(p, times(radius, tip)))), faces = points.flatMap((_, k) => sides.map((side) => 6 * k + side));
  return withNormals(new Float32Array(positions), new Uint32Array(faces));
}

class Layer {
  constructor(viewer, array) {
    const { layer } = viewer.robot;
    Object.assign(this, { viewer, time: layer.time && array(layer.time) });
    this.groups = layer.groups.map((group) => ({ ...group, points: array(group.points), along: array(group.along), shares: group.shares && array(group.shares) }));
    this.workspace = layer.workspace && this.dots(layer.workspace, array);
    const place_ = document.getElementById("layer"), legend = place_.querySelector("p");
    place_.hidden = false;
    const [verdict, meaning] = viewer.motion ? [] : printed(layer.told).split("\n"); // a motion's verdict says it
    place_.querySelector("span").textContent = verdict || "";
    place_.querySelector("div").textContent = meaning || "";
    for (const { name, colour } of this.groups) {
      const chip = legend.appendChild(document.createElement("span"));
      chip.appendChild(document.createElement("i")).style.background = css(colour);
      chip.append(name);
    }
    if (!this.workspace) return;
    this.chip = legend.appendChild(document.createElement("span"));
    this.chip.appendChild(document.createElement("i")).style.cssText = `width: 60px; background: linear-gradient(to right, ${layer.workspace.colours.map(css)})`;
    this.chip.append(layer.workspace.name);
  }

  dots({ points, steps, colours }, array) { // a surface of each colour
    const places = array(points), step = array(steps), { size } = this.viewer.robot;
    return colours.map((colour, k) => {
      const own = Array.from(step.keys()).filter((i) => step[i] === k).map((i) => Array.from(places.subarray(3 * i, 3 * i + 3)));
      return { colour, places: own, surface: () => octahedra(own, DOT * size) };
    });
  }

  get reach() { // first places of all arrows, and their heads
    return this.groups.flatMap((group) => Array.from({ length: group.count }, (_, c) => {
      const [p, along] = this.arrow(group, c);
      return this.time ? [p] : [p, add(p, along)];
    }).flat());
  }

  arrow({ points, along }, at) { return [points, along].map((all) => Array.from(all.subarray(3 * at, 3 * at + 3))); }

  get row() { // of the motion: the nearest
    if (!this.time) return 0;
    const { time, viewer } = this, after = time.findIndex((t) => t >= viewer.time);
    return after < 0 ? time.length - 1 : after > 0 && viewer.time - time[after - 1] < time[after] - viewer.time ? after - 1 : after;
  }

  get holds() { // of what is seen: forces are those of the command's load at its own speed
    const { viewer } = this;
    return !this.time || (!viewer.posed && !viewer.judge.moved);
  }

  colour(group, at) {
    const share = group.shares ? group.shares[at] : 0, { shares } = this.viewer.robot.colours;
    return isOver(share) ? shares[shares.length - 1][1] : share > shares[1][0] ? shares[2][1] : group.colour;
  }

  marks(items) {
    const { viewer } = this, { size } = viewer.robot;
    if (this.chip) this.chip.hidden = !viewer.shown.workspace;
    if (viewer.shown.workspace) this.workspace.forEach(({ colour, places, surface }, k) => {
      if (places.length) items.push({ kept: viewer.cached(`workspace ${k}`, surface), model: shifted([0, 0, 0]), colour: [...colour, 1] });
    });
    if (!viewer.shown.layer || !this.holds) return;
    for (const group of this.groups)
      for (let c = 0; c < group.count; c++) {
        const at = group.count * this.row + c, [p, along] = this.arrow(group, at);
        const length = Math.round((200 * norm(along)) / size) / 200;
        if (length < SHORTEST) continue;
        items.push({ kept: viewer.cached(`layer ${length}`, () => arrow(length, Math.min(THICKEST, 0.12 * length))), model: mul(mul(shifted(p), alongZ(along)), scaling(size)), colour: [...this.colour(group, at), 1] });
      }
  }
}
