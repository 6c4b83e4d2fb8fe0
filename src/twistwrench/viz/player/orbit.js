// A camera that orbits what it looks at, steered by mouse, fingers, wheel and keys; how it draws is for those who extend it.
"use strict";

const LONG_PRESS = 500; // ms

class Orbit {
  constructor(canvas, size) {
    Object.assign(this, { canvas, size, target: [0, 0, 0], covered: { right: 0, top: 0, bottom: 0 } });
    this.home = { azimuth: -0.9, elevation: 0.35, distance: 2.05 * size };
    Object.assign(this, this.home);
    this.guest = false; // within another page, whose wheel and finger scroll
    this.fixed = false; // a plane seen from above, which is not turned
    this.floor = -Infinity; // height of the floor, which the camera stays above
    this.hint = () => {}; // tells how to zoom
    this.touched = () => {}; // the view may have changed
    this.seize = null; // takes (x, y) of a press with Ctrl, or of a long one of a finger: null, or such a function, whose end() lets go
    this.grasp = null; // takes (x, y) of a press, and how far off it may be: null, or a function of (dx, dy) that moves what was pressed on
    this.steer();
  }

  camera() {
    const [c, s] = [Math.cos(this.elevation), Math.sin(this.elevation)];
    const back = [c * Math.cos(this.azimuth), c * Math.sin(this.azimuth), s];
    const right = [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0], up = cross(back, right);
    const eye = add(this.target, times(this.distance, back));
    const view = [...right, -dot(right, eye), ...up, -dot(up, eye), ...back, -dot(back, eye), 0, 0, 0, 1];
    const near = 0.02 * this.distance, far = this.distance + 20 * this.size;
    const [width, height] = [Math.max(1, this.canvas.clientWidth), Math.max(1, this.canvas.clientHeight)], aspect = width / height, free = 1 - (this.covered.top + (this.covered.foot ?? 0)) / height;
    const f = Math.min(1, free / Math.min(1, aspect), Math.max(1, aspect) * (1 - (this.covered.side ?? 0) / width)) / Math.tan(0.3);
    const depth = [(far + near) / (near - far), (2 * far * near) / (near - far)];
    const lens = [f / Math.max(aspect, 1e-3), 0, 0, 0, 0, f, 0, 0, 0, 0, ...depth, 0, 0, -1, 0];
    if (aspect < 1) [lens[0], lens[5]] = [f, f * aspect];
    [lens[2], lens[6]] = [this.covered.right / width, (this.covered.top - this.covered.bottom) / height]; // the middle of what nothing covers
    return { camera: mul(lens, view), eye, right, up };
  }

  // All that the view depends on.
  get signs() {
    const { azimuth, elevation, distance, target, covered, canvas } = this;
    return [azimuth, elevation, distance, ...target, covered.right, covered.top, covered.bottom, canvas.clientWidth, canvas.clientHeight, window.devicePixelRatio].join();
  }

  // Where on the canvas points are, in its own pixels.
  projected(points) {
    const M = this.camera().camera, { clientWidth: width, clientHeight: height } = this.canvas;
    return points.map((point) => {
      const [x, y, , w] = [0, 1, 2, 3].map((i) => dot(M.slice(4 * i, 4 * i + 3), point) + M[4 * i + 3]);
      return [((x / w + 1) / 2) * width, ((1 - y / w) / 2) * height];
    });
  }

  project(point) { return this.projected([point])[0]; }

  // Where a place of the canvas looks from, and along which unit vector.
  ray(x, y) {
    const { camera, eye, right, up } = this.camera(), back = cross(right, up), { clientWidth: width, clientHeight: height } = this.canvas;
    const u = 1 - (2 * x) / width, v = (2 * y) / height - 1, row = (i) => camera.slice(4 * i, 4 * i + 3), w = row(3); // (row0 + u w) d = (row1 + v w) d = 0
    const way = unit(cross(add(row(0), times(u, w)), add(row(1), times(v, w))));
    return [eye, dot(way, back) > 0 ? times(-1, way) : way];
  }

  metre(point) { // its length in pixels across the view at a point
    const at = this.project(point);
    return Math.hypot(...this.project(add(point, this.camera().up)).map((end, i) => end - at[i]));
  }

  get lowest() { // elevation [rad]; to the floor, or within another page to the horizon
    const sine = (this.floor - this.target[2]) / this.distance;
    return this.guest ? 0.02 : Math.max(-1.2, Math.asin(Math.max(-1, Math.min(1, sine))) + 0.02);
  }

  keepAbove() { this.elevation = Math.min(1.55, Math.max(this.lowest, this.elevation)); }

  // Within another page: its wheel and vertical swipes scroll that page, two fingers turn the view.
  visit(guest) {
    this.guest = guest;
    this.canvas.style.touchAction = guest ? "pan-y" : "none";
    this.elevation = Math.max(this.lowest, this.elevation);
  }

  steer() { // drag orbits, with the right button or two fingers it shifts; the wheel and pinching zoom
    const canvas = this.canvas, fingers = new Map();
    let held = null, long = 0, still = true;
    for (const event of ["pointerdown", "pointermove", "pointerup", "wheel", "keydown", "dblclick"]) canvas.addEventListener(event, () => this.touched(), { passive: true });
    const orbit = (dx, dy) => {
      if (this.fixed) return;
      this.azimuth -= 0.008 * dx;
      this.elevation += 0.008 * dy;
      this.keepAbove();
    };
    const shift = (dx, dy) => {
      const { right, up } = this.camera(), scale = (0.62 * this.distance) / canvas.clientHeight;
      this.target = add(this.target, add(times(-scale * dx, right), times(scale * dy, up)));
      this.target[2] = Math.max(this.floor, this.target[2]);
      this.keepAbove();
    };
    const zoom = (factor) => { this.distance = Math.min(40 * this.size, Math.max(0.05 * this.size, this.distance * factor)); this.keepAbove(); };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      const box = canvas.getBoundingClientRect();
      const [x, y] = [event.clientX - box.x, event.clientY - box.y], pulls = (event.ctrlKey || event.metaKey) && this.seize, takes = pulls ? this.seize : this.grasp;
      held = event.button === 0 && !fingers.size && takes ? takes(x, y, event.pointerType === "touch" ? 36 : 20) : null;
      if (event.pointerType === "touch" && !held && !fingers.size && this.seize) {
        still = true;
        long = setTimeout(() => { if (still && fingers.size === 1) held = this.seize(x, y); }, LONG_PRESS);
      }
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
      if (Math.hypot(dx, dy) > 3) still = false;
      if (held && fingers.size === 1) held(dx, dy);
      else if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const far = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        zoom(far(before) / far([event.clientX, event.clientY]));
        (this.guest ? orbit : shift)(dx / 2, dy / 2);
      } else if (event.buttons & 2 || event.buttons & 4 || event.shiftKey) shift(dx, dy);
      else orbit(dx, dy);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => {
      fingers.delete(event.pointerId);
      clearTimeout(long);
      held?.end?.();
      held = null;
    });
    canvas.addEventListener("touchstart", (event) => { // what was taken hold of, and two fingers, are not for the page around
      if (event.cancelable && (held || event.touches.length > 1)) event.preventDefault();
    }, { passive: false });
    canvas.addEventListener("wheel", (event) => {
      if (this.guest && !event.ctrlKey && !event.metaKey) return this.hint();
      event.preventDefault();
      zoom(Math.exp(0.0012 * event.deltaY));
    }, { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    const keys = {
      ArrowLeft: () => orbit(-12, 0), ArrowRight: () => orbit(12, 0), ArrowUp: () => orbit(0, -12), ArrowDown: () => orbit(0, 12),
      "+": () => zoom(0.9), "-": () => zoom(1 / 0.9), Home: () => Object.assign(this, this.home),
    };
    canvas.addEventListener("keydown", (event) => {
      const act = event.ctrlKey || event.metaKey || event.altKey ? undefined : keys[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    });
    canvas.addEventListener("dblclick", () => Object.assign(this, this.home));
  }
}
