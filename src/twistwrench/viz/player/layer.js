// A result over the robot: arrows at fixed places, or along the motion, with the sentence of the command.
"use strict";

const SHORTEST = 0.01, THICKEST = 0.008; // of an arrow that is drawn, as shares of the robot's size

class Layer {
  constructor(viewer, array) {
    const { layer } = viewer.robot;
    Object.assign(this, { viewer, time: layer.time && array(layer.time) });
    this.groups = layer.groups.map((group) => ({ ...group, points: array(group.points), along: array(group.along), shares: group.shares && array(group.shares) }));
    const place_ = document.getElementById("layer"), legend = place_.querySelector("p");
    place_.hidden = false;
    place_.querySelector("span").textContent = viewer.motion ? "" : printed(layer.told); // a motion's verdict says it
    for (const { name, colour } of this.groups) {
      const chip = legend.appendChild(document.createElement("span"));
      chip.appendChild(document.createElement("i")).style.background = css(colour);
      chip.append(name);
    }
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
