// The menu: a link to what is seen, the same in Python, a picture of it, and back to how the page opened.
"use strict";

const listOf = (values) => `[${Array.from(values, String).join(", ")}]`;

// A program that gives the torques that are seen: of the motion, or those that hold the pose.
function pythonOf(viewer) {
  const { robot, mechanics, motion, posed, q, time } = viewer, { python } = robot, { mass, push } = mechanics, pushed = push.some((x) => x);
  const frame = JSON.stringify(robot.payloadFrame), tip = robot.tip === null ? "" : JSON.stringify(robot.frames[robot.tip].name);
  const lines = ["import numpy as np", "import twistwrench as tw", "", `robot = ${python.robot}`];
  for (const other of python.payloads) lines.push(`robot = robot.with_payload(tw.SpatialInertia.from_com(${other.mass}, ${listOf(other.place)}), frame=${JSON.stringify(other.frame)})`);
  if (mass) lines.push(`robot = robot.with_payload(tw.SpatialInertia.from_com(${mass}, ${listOf(robot.payloadPlace)}), frame=${frame})`);
  if (motion && !posed && python.log) {
    const s = motion.pace, friction = motion.data.viscous ? ", friction=True" : "";
    const given = robot.wrenchFrames.map((name, k) => [name, mechanics.given[k]]).filter(([, F]) => F.some((x) => x));
    lines.push(`motion = tw.Motion.from_file(${python.log}, robot)`, `wrenches = {${given.map(([name, F]) => `${JSON.stringify(name)}: np.tile(${listOf(F)}, (len(motion.q), 1))`).join(", ")}}`);
    if (pushed) lines.push(`R = robot.forward_kinematics(motion.q, ${tip})[:, :3, :3]  # the push keeps its direction in the base`, `push = np.concatenate([np.zeros((len(motion.q), 3)), ${listOf(push)} @ R], axis=1)`, `wrenches[${tip}] = wrenches.get(${tip}, 0) + push`);
    lines.push(`speed = ${s}`, `tau = robot.inverse_dynamics(motion.q, speed * motion.dq, speed**2 * motion.ddq, wrench_on_robot=wrenches${friction})`, "print(np.abs(tau).max(axis=0))");
    return lines.join("\n");
  }
  const on = mechanics.wrenches(q).map((F, k) => [robot.wrenchFrames[k], F]).filter(([, F]) => F.some((x) => x));
  lines.push(`q = ${listOf(q)}`, `wrenches = {${on.map(([name, F]) => `${JSON.stringify(name)}: ${listOf(F)}`).join(", ")}}`, "tau = robot.holding_torques(q, wrench_on_robot=wrenches)", "print(tau)");
  return lines.join("\n");
}

class Menu {
  constructor(viewer) {
    Object.assign(this, { viewer, box: document.getElementById("menu"), field: document.getElementById("copied") });
    document.getElementById("copy-link").hidden = location.protocol === "about:"; // in a frame of a notebook there is no address
    const at = (id, act) => document.getElementById(id).addEventListener("click", act);
    at("copy-link", () => this.copy(this.link(), location.protocol === "file:" ? "Put this behind the page's name; the file goes with it." : "The link to what you see."));
    at("copy-python", () => this.copy(pythonOf(viewer), "What you see, in Python."));
    at("take-picture", () => this.save());
    at("reset", () => this.reset());
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.box.open = false;
      if (event.key.toLowerCase() !== "r" || event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "range") return;
      this.reset();
    });
  }

  reset() { this.viewer.playing = false; this.viewer.address.reset(); }

  link() {
    const hash = `#${this.viewer.address.hash}`;
    return location.protocol === "file:" ? hash : location.href.replace(/#.*/, "") + hash;
  }

  async copy(text, said) { // where the clipboard is refused, the text stands selected in the field
    const [field, note] = [this.field, document.getElementById("said")];
    Object.assign(field, { value: text, hidden: false });
    field.rows = Math.min(12, text.split("\n").length);
    try {
      await navigator.clipboard.writeText(text);
      note.textContent = `Copied. ${said}`;
    } catch {
      field.focus();
      field.select();
      note.textContent = `Copy this. ${said}`;
    }
  }

  picture() { // at twice the size, with the verdict and the scale
    const { viewer } = this, { stage, robot, answer: verdict } = viewer, { canvas, covered } = stage, ratio = 2;
    viewer.draw({ ...FINENESS[0], exact: ratio });
    viewer.changes += 1; // so that the screen is drawn anew
    const width = Math.round(canvas.clientWidth - covered.right), height = canvas.clientHeight, paper = document.createElement("canvas"), draw = paper.getContext("2d");
    Object.assign(paper, { width: ratio * width, height: ratio * height });
    draw.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement), ink = (name) => style.getPropertyValue(name).trim(), font = getComputedStyle(document.body).fontFamily;
    draw.fillStyle = ink("--stage-2");
    draw.fillRect(0, 0, width, height);
    draw.drawImage(canvas, 0, 0, canvas.width * (width / canvas.clientWidth), canvas.height, 0, 0, width, height);
    let y = 30;
    const line = (text, colour, size) => {
      Object.assign(draw, { font: size, fillStyle: ink(colour), strokeStyle: ink("--halo"), lineWidth: 3, lineJoin: "round" });
      let row = "";
      const put = () => { draw.strokeText(row, 18, y); draw.fillText(row, 18, y); y += 19; row = ""; };
      text.split(" ").forEach((word) => { if (row && draw.measureText(`${row} ${word}`).width > width - 36) put(); row = row ? `${row} ${word}` : word; });
      if (row) put();
    };
    line(robot.name, "--ink", `650 18px ${font}`);
    const put = [...(viewer.mechanics.mass ? [`${robot.payloadName}: ${plain(viewer.mechanics.mass)} kg`] : []), ...(viewer.motion && viewer.motion.pace !== 1 ? [`motion speed ${plain(viewer.motion.pace)} ×`] : [])];
    line([...put, `squares of ${squareOf(robot.size)} m`].join(" · "), "--quiet", `13px ${font}`);
    if (verdict) verdict.text.split("\n").forEach((text, k) => line(text, k || verdict.word === "OK" ? "--ink" : "--over", `${k ? "" : "650 "}14px ${font}`));
    return paper;
  }

  save() {
    this.picture().toBlob((blob) => {
      const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: `${this.viewer.robot.name}.png` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
  }
}
