// What is seen, in the page's address: #q=…&load=5&push=0,0,-60&speed=1&t=1.808&camera=…&layers=…
"use strict";

const STEPS = 100; // that can be undone
const STEP = 1000; // ms, within which presses of keys are one step

const brief = (x) => Number(x.toPrecision(6));

// The part of the address behind #, of what differs from the state that the page opens with.
function written(state, first) {
  const text = (value) => (Array.isArray(value) ? value.map((x) => (typeof x === "number" ? brief(x) : x)).join() : String(brief(value)));
  return Object.entries(state).filter(([key, value]) => value !== null && text(value) !== (first[key] === null ? "" : text(first[key]))).map(([key, value]) => `${key}=${text(value)}`).join("&");
}

// The state that an address tells: unknown keys are left out, and values that cannot be.
function read(hash, robot, first) {
  const state = { ...first, ...(robot.motion ? { q: null } : {}) }, keys = new URLSearchParams(hash.replace(/^#/, ""));
  const numbers = (key, count) => { const all = (keys.get(key) ?? "").split(",").map((x) => (x.trim() ? Number(x) : NaN)); return all.length === count && all.every(Number.isFinite) ? all : null; };
  const one = (key, fits) => { const [x] = numbers(key, 1) ?? [NaN]; if (first[key] !== null && fits(x)) state[key] = x; };
  one("load", (x) => x >= 0);
  one("speed", (x) => x >= 0.01 && x <= 100);
  one("t", Number.isFinite);
  const tip = robot.tips.findIndex((entry) => robot.frames[entry.tip].name === keys.get("tip"));
  if (tip >= 0) state.tip = [keys.get("tip")];
  state.push = (first.push && numbers("push", 3)) || first.push;
  state.q = numbers("q", robot.coordinates.length) || state.q;
  const camera = numbers("camera", 6);
  if (camera && camera[2] > 0) state.camera = camera;
  if (keys.has("layers")) state.layers = keys.get("layers").split(",").filter((key) => robot.switches.some(([known]) => known === key));
  return state;
}

class Address {
  constructor(viewer) {
    this.viewer = viewer;
    this.first = this.state;
    this.words = ["embed", "full"].filter((word) => location.hash.slice(1).split("&").includes(word)); // kept in front
    if (location.hash.length > 1) this.open();
    Object.assign(this, { present: this.hash, past: [], undone: [], byKey: false, last: -Infinity });
    addEventListener("hashchange", () => { this.open(); this.note(true); });
    addEventListener("pointerdown", () => { this.byKey = false; }, true);
    addEventListener("keydown", (event) => this.key(event), true);
    const { canvas } = viewer.stage; // a change of the view is no step of its own
    for (const event of ["pointerup", "keyup", "dblclick"]) canvas.addEventListener(event, () => { this.note(viewer.grasp.moved); viewer.grasp.moved = false; });
    canvas.addEventListener("wheel", () => { clearTimeout(this.later); this.later = setTimeout(() => this.note(false), 300); }, { passive: true });
  }

  get state() {
    const { mechanics, motion, posed, q, time, stage, shown, robot } = this.viewer, { azimuth, elevation, distance, target } = stage;
    return {
      q: posed || !motion ? q.slice() : null,
      load: robot.payload === null ? null : mechanics.mass, push: robot.payload === null ? null : mechanics.push.slice(),
      tip: robot.tips.length ? [robot.frames[robot.tip].name] : null, speed: motion ? motion.pace : null, t: motion && !posed ? motion.shown(time) : motion ? motion.begin : null,
      camera: [azimuth, elevation, distance, ...target], layers: robot.switches.map(([key]) => key).filter((key) => shown[key]),
    };
  }

  get hash() { return [...this.words, written(this.state, this.first)].filter(Boolean).join("&"); }

  note(release) { // a release is a step that can be undone, keys pressed within a second are one; all else changes the step that is there
    const hash = this.hash, now = performance.now();
    if (this.opening || this.present === hash) return;
    if (release && !(this.byKey && now - this.last < STEP)) {
      this.past = [...this.past, this.present].slice(-STEPS);
      this.undone = [];
    }
    if (release) this.last = this.byKey ? now : -Infinity;
    this.keep(hash);
  }

  keep(hash) { // the browser's back button leaves the page, so its history is not written
    this.present = hash;
    if (location.hash.slice(1) === hash) return;
    try { history.replaceState(null, "", `#${hash}`); } catch { this.off = true; } // in a frame without an address
  }

  key(event) {
    const typing = event.target.tagName === "TEXTAREA" || (event.target.tagName === "INPUT" && event.target.type !== "range");
    this.byKey = !typing;
    if (typing || event.altKey || !(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    if (event.shiftKey) this.step(this.undone, this.past);
    else this.step(this.past, this.undone);
  }

  step(from, to) { // one back, or forth
    if (!from.length) return;
    to.push(this.present);
    const hash = from.pop();
    this.last = -Infinity;
    this.show(read(hash, this.viewer.robot, this.first));
    this.keep(hash);
  }

  open() { this.show(read(location.hash, this.viewer.robot, this.first)); }

  show({ q, load, push, tip, speed, t, camera, layers }) {
    const { viewer } = this, { mechanics, motion, stage, robot } = viewer;
    this.opening = true;
    const chosen = tip ? robot.tips.findIndex((entry) => robot.frames[entry.tip].name === tip[0]) : -1;
    if (chosen >= 0 && chosen !== robot.chosenTip) viewer.chooseTip(chosen);
    if (load !== null) Object.assign(mechanics, { mass: load, push: push.slice() });
    if (motion) motion.pace = speed;
    viewer.loaded();
    if (q) viewer.setCoordinates(viewer.closed(q.slice()));
    else if (motion) viewer.seek(motion.given(t));
    Object.assign(stage, { azimuth: camera[0], elevation: camera[1], distance: camera[2], target: camera.slice(3) });
    stage.keepAbove();
    robot.switches.forEach(([key]) => viewer.panel.show(key, layers.includes(key)));
    viewer.panel.load.tell();
    viewer.panel.update();
    this.opening = false;
  }

  reset() {
    this.show(this.first);
    this.note(true);
  }
}
