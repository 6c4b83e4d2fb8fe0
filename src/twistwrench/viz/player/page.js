// The page: reads its data, keeps what is shown (a pose, or a moment of the motion), and draws it.
"use strict";

async function unpack(text) { // base64 of zlib of: length of the header, the header as JSON, and the arrays it tells of
  const packed = Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = await new Response(stream).arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, length)));
  const start = 8 + Math.ceil(length / 8) * 8, kinds = { f4: Float32Array, f8: Float64Array, u2: Uint16Array, u4: Uint32Array };
  const array = ({ at, count, kind }) => new kinds[kind](bytes, start + at, count);
  return { robot: header, array };
}

class Viewer {
  constructor(robot, array) {
    this.robot = robot;
    this.q = robot.start.slice();
    for (const owner of [robot, ...robot.tips])
      for (const scale of ["forceScale", "massScale"]) if (owner[scale]) owner[scale] = squareOf(robot.size) / perSquare(1, owner[scale], robot.size);
    this.mechanics = new Mechanics(robot);
    this.fall = null; // while it is let go
    this.loops = robot.loops && new Loops(this.mechanics);
    this.stand = robot.standing && new Standing(this.mechanics);
    this.shown = { ...robot.shown };
    this.stage = stageOn(document.getElementById("stage"), robot.size);
    this.stage.target = robot.target.slice();
    this.stage.home.target = robot.target.slice();
    this.stage.floor = robot.floor;
    this.made = new Map();
    const surfaces = robot.surfaces.map(({ vertices, faces, low, step }) => {
      const grid = array(vertices), positions = new Float32Array(grid.length);
      for (let k = 0; k < grid.length; k++) positions[k] = low[k % 3] + step[k % 3] * grid[k];
      return this.stage.keep(withNormals(positions, Uint32Array.from(array(faces))));
    });
    this.shapes = robot.shapes.map((shape) => ({ ...shape, kept: surfaces[shape.surface] }));
    this.ball = this.stage.keep(ball());
    this.motion = robot.motion && new Motion(this.mechanics, robot.motion, array);
    if (this.motion && robot.payload !== null) this.trace();
    this.judge = this.motion && new Verdict(this.motion, robot);
    this.verdict = this.judge && this.judge.now;
    this.time = this.motion ? this.motion.begin : 0; // of the motion as it was given
    this.posed = true; // by the sliders, as opposed to a moment of the motion
    this.moving = false;
    this.once = false; // to the end of the motion, and not again from its start
    this.speed = 1;
    this.sharpness = new Sharpness();
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", () => { this.changes += 1; });
    this.changed = 0; // times
    this.panel = new Panel(this);
    this.grasp = new Grasp(this);
    this.grab = new Grab(this);
    this.layer = robot.layer && new Layer(this, array);
    this.book = robot.book && new Book(this);
    if (this.motion) this.seek(this.time);
    else this.refresh();
    this.address = new Address(this);
    this.menu = new Menu(this);
    this.compact = new Compact(this);
    addEventListener("beforeprint", () => this.print(document.getElementById("paper")));
    this.stage.touched = () => this.request();
    addEventListener("resize", () => this.request());
    this.request();
  }

  get changes() { return this.changed; } // of what is drawn
  set changes(count) { this.changed = count; this.request(); }
  get playing() { return this.moving; }
  set playing(on) { this.moving = on; this.request(); }

  request() { // of a frame; at rest none is
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.asked = false;
    this.advance(now);
    const fineness = this.sharpness.at(now, `${this.changes} ${this.stage.signs}`);
    if (fineness) this.draw(fineness);
    if (this.playing || (this.fall && (!this.fall.rests || this.grab.held)) || this.sharpness.waits(now)) this.request();
    else this.now = undefined; // the clock stands until it is looked at again
  }

  advance(now) {
    const past = Math.min(0.1, (now - (this.now ?? now)) / 1000);
    this.now = now;
    if (this.glide) this.gliding(now);
    if (this.fall) this.fallOn(past);
    if (!this.playing) return;
    const { begin, end, pace } = this.motion;
    let time = this.time + this.speed * pace * past;
    if (time > end && this.once) {
      this.playing = this.once = false;
      time = begin;
    } else if (time > end) time = end > begin ? begin + ((time - begin) % (end - begin)) : begin;
    this.seek(time);
  }

  // Places of bodies and tip over the motion; of a pose also the corners of the box around its shapes.
  get reach() {
    const { robot, motion, mechanics } = this, n = motion ? motion.q.length : 1;
    const rows = motion ? Array.from({ length: REACH }, (_, k) => Array.from(motion.q[Math.round((k * (n - 1)) / (REACH - 1))])) : [this.q];
    const corners = robot.box ? Array.from({ length: 8 }, (_, k) => [0, 1, 2].map((i) => robot.box[(k >> i) & 1][i])) : [];
    const low = this.raised && (this.fall || !this.compact.embedded) ? [[0, 0, this.ground]] : []; // in a frame, the arm alone until it falls
    return [...corners, ...low, ...(this.layer ? this.layer.reach : [])].concat(rows.flatMap((q) => {
      const poses = mechanics.poses(q), places = robot.bodies.map((_, k) => place(poseOf(poses, k)));
      return [place(poseOf(poses, -1)), ...places, ...(robot.payload === null ? [] : [place(mechanics.tipPose(q))])];
    }));
  }

  seek(time) { // the state of the motion at a time, between two samples a mean of both
    const t = this.motion.time;
    this.time = Math.min(t[t.length - 1], Math.max(t[0], time));
    let low = 0, high = t.length - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (t[middle] <= this.time) low = middle; else high = middle; }
    high = Math.min(high, t.length - 1);
    const share = high > low ? (this.time - t[low]) / (t[high] - t[low]) : 0;
    this.posed = false;
    if (this.fall) this.lift();
    this.fall = null;
    const { q } = this.motion, after = this.motion.row(high);
    this.q = between(this.robot, Array.from(q[low]), Array.from(q[high]), share);
    this.tau = Array.from(this.motion.row(low), (x, k) => (1 - share) * x + share * after[k]);
    this.refresh();
  }

  setCoordinates(q) { // by hand: the torques are then those that hold the robot
    this.q = q;
    this.posed = true;
    this.playing = false;
    if (this.fall) this.lift();
    this.fall = this.drives = null;
    this.stopped = false;
    this.refresh();
  }

  get holds() { return this.loops && (!this.stand || this.shown.feet); } // loops are closed, or feet on the floor

  closed(q) { return this.holds ? this.loops.closed(q, this.loops.following([])) ?? this.robot.start.slice() : q; }

  slide(k, value) { // a slider; where loops are closed others follow, and it stops where they cannot
    const { panel, loops } = this;
    if (!this.holds) return this.setCoordinates(panel.grasp(k, value));
    const from = panel.valueOf(k, this.q), found = loops.led(this.q, (q, share) => panel.grasp(k, from + share * (value - from), q), this.robot.hands[k].v);
    this.setCoordinates(found.q);
    this.stopped = found.stopped;
    this.panel.update();
  }

  shows(k) { // torques without a motor are not listed while loops and feet hold the robot
    return !this.posed || !this.holds || (this.stand ? this.robot.torques[k].driven : this.loops.actuated[k]);
  }

  letGo() {
    this.setCoordinates(this.q);
    if (this.book) this.mechanics.tau = this.book.state.tau.slice();
    this.drop(this.book ? this.book.velocities : []);
    this.lower();
    this.refresh();
  }

  lower() { // the view, so that a pedestal and what hangs from it are seen
    const { stage, robot, compact, reach } = this, top = Math.max(...reach.map(([, , z]) => z)), height = top - this.ground;
    if (!this.raised) return;
    this.above = { target: stage.target, distance: stage.distance };
    if (compact.embedded) compact.approach(reach);
    else Object.assign(stage, { target: [stage.target[0], stage.target[1], this.ground + height / 2], distance: Math.max(stage.distance, 2.1 * Math.max(height, robot.size)) });
    this.glide = { begun: null, from: this.above, to: { target: stage.target, distance: stage.distance } };
  }

  gliding(now) { // towards what is seen below
    const { from, to } = this.glide;
    this.glide.begun ??= now;
    const share = UNMOVED.matches ? 1 : Math.min(1, (now - this.glide.begun) / GLIDE), eased = share * share * (3 - 2 * share), between_ = (a, b) => a + eased * (b - a);
    Object.assign(this.stage, { target: from.target.map((x, i) => between_(x, to.target[i])), distance: between_(from.distance, to.distance) });
    if (share === 1) this.glide = null;
  }

  drop(dq) {
    this.mechanics.open = Boolean(this.loops) && !this.holds;
    const floor = this.book ? null : new Floor(this.mechanics, this.robot.floor - this.robot.fall.pedestal, this.q);
    if (!this.book) this.mechanics.tau = this.tau.map(() => 0);
    this.fall = new Fall(this.mechanics, this.q, dq, Boolean(this.shown.stops), this.holds ? this.loops : null, floor);
    this.drives = this.shown.drives ? new Drives(this.mechanics, this.drives?.pose ?? this.q) : null;
    if (this.drives) this.fall.forces.push((q, v) => this.drives.torques(q, v));
    if (this.grab.can) this.fall.forces.push((q, v) => (this.grab.held ? this.grab.torques(q, v) : this.tau.map(() => 0)));
  }

  get ground() { return this.robot.floor - (this.raised ? this.robot.fall.pedestal : 0); } // height of the floor that is drawn
  get raised() { return !this.book && this.robot.fall.pedestal > 0 && Boolean(this.fall || (this.compact?.embedded && this.robot.control === "fall")); }

  fallOn(seconds) {
    if (this.fall.rests && !this.grab.held) return;
    this.fall.advance(seconds);
    this.q = this.fall.q;
    if (this.book) this.book.state.dq = this.fall.dq;
    this.refresh();
  }

  stop() { this.setCoordinates(this.q); }

  lift() { // the view, back to where it was; in a frame an arm that was stopped hangs below it
    if (this.above && !this.compact.embedded) Object.assign(this.stage, this.above);
    this.above = this.glide = null;
  }

  chooseTip(k) { // payload, push, dragging and ellipsoids go with it
    this.mechanics.choose(k);
    if (this.motion) this.trace();
    this.panel.load.tell();
    this.loaded();
  }

  trace() { // the path of the tip over the motion
    const { q } = this.motion, most = Math.min(q.length, 2000), row = (i) => q[Math.round((i * (q.length - 1)) / Math.max(1, most - 1))];
    if (this.path) this.stage.forget(this.path);
    this.path = this.stage.keep({ positions: Float32Array.from(Array.from({ length: most }, (_, i) => Array.from(place(this.mechanics.tipPose(row(i))))).flat()) });
  }

  loaded() { // payload, push or speed changed
    if (this.motion) {
      this.motion.run();
      this.verdict = this.judge.now;
      this.panel.strip.draw();
    }
    if (this.fall) this.fall.reckon();
    else if (this.motion && !this.posed) return this.seek(this.time);
    this.refresh();
  }

  settled() { // a slider was let go, or a value typed
    this.panel.tell();
    this.address?.note(true);
  }

  get over() { // torques whose joints are red: over the whole motion, or where the robot is held
    if (this.motion && !this.posed) return this.verdict.over;
    if (this.drives) return new Set(this.slipping.map(({ k }) => k));
    return new Set(this.tau.flatMap((x, k) => (this.robot.torques[k].limit && isOver(x / this.robot.torques[k].limit) ? [k] : [])));
  }

  get slipping() { return this.drives.slipping(this.q, this.grab.held && this.grab.torques(this.q)); }

  get answer() { // the verdict on the motion, if it is judged; never OK beside a joint that is red at a pose set by hand
    if (this.motion && !this.motion.data.judged) return null;
    const { verdict, over, posed, tau, robot } = this;
    if (!verdict || verdict.word !== "OK" || !posed || !over.size) return verdict;
    const share = (k) => Math.abs(tau[k]) / robot.torques[k].limit, worst = [...over].reduce((a, b) => (share(b) > share(a) ? b : a)), { name, unit, limit } = robot.torques[worst];
    const held = `: ${name} needs ${torqueText(tau[worst])} ${unit} to hold this pose, ${percentOfLimit(share(worst))} of its limit (${number(limit)} ${unit}).`;
    return { ...verdict, word: "OVER LIMIT", lines: [held, "The motion itself keeps all limits."], text: `OVER LIMIT${held}` };
  }

  set(input) { // of a section of the book: torques may change while it moves
    if (this.fall && input === "tau") {
      this.mechanics.tau = this.book.state.tau.slice();
      this.fall.reckon();
    } else this.fall = null;
    this.refresh();
  }

  refresh() {
    this.changes += 1;
    this.poses = this.mechanics.poses(this.q);
    if (this.book) this.tau = this.book.update();
    else if (this.posed) this.hold();
    this.forces = this.masses = null;
    if (this.shown.mass) this.weigh();
    this.panel.update();
  }

  hold() { // the torques that hold the pose, of motors alone where loops are closed or feet on the floor
    const holding = this.fall ? this.robot.torques.map(() => 0) : Array.from(this.mechanics.holding(this.q));
    this.support = this.holds && this.stand && !this.fall ? this.stand.held(this.q) : null;
    const pull = this.grab?.held && !this.fall ? this.grab.torques(this.q) : null; // tau = g - J' f
    this.borne = this.holds && !this.stand && !this.fall ? this.loops.torques(this.q, pull ? holding.map((x, k) => x - pull[k]) : holding) : null;
    this.tau = this.drives ? this.drives.torques(this.q, this.fall.dq) : (this.support ?? this.borne)?.tau ?? (pull ? holding.map((x, k) => x - pull[k]) : holding);
  }

  // Of each torque: its share of the limit, else of the largest of the motion, else of the largest there is now.
  shares() {
    const most = Math.max(1e-9, ...this.tau.map(Math.abs));
    return this.tau.map((x, k) => x / (this.robot.torques[k].limit || (this.motion && Math.abs(this.motion.peaks[k].value)) || most));
  }

  colour(k, share) {
    if (!this.robot.torques[k].limit) return this.robot.colours.unlimited;
    const stops = this.robot.colours.shares, x = isOver(share) ? Infinity : Math.abs(share);
    const next = stops.findIndex(([at]) => x <= at);
    if (next === 0) return stops[0][1];
    if (next < 0) return stops[stops.length - 1][1];
    const [[a, from], [b, to]] = [stops[next - 1], stops[next]];
    return from.map((c, i) => c + ((x - a) / (b - a)) * (to[i] - c));
  }

  seen(colour) { return this.dark.matches ? colour.map((x) => 0.7 + 0.3 * x) : colour; } // dark marks, on a dark stage

  cached(key, make) { // arrows and arcs come in some hundred sizes
    if (!this.made.has(key)) {
      if (this.made.size > 600) { this.made.forEach((kept) => this.stage.forget(kept)); this.made.clear(); }
      this.made.set(key, this.stage.keep(make()));
    }
    return this.made.get(key);
  }

  draw(fineness = FINENESS[0]) {
    const { robot, poses, shown, ground } = this, items = [], lines = [], size = robot.size, red = this.redBodies();
    lines.push({ kept: this.cached(`grid ${ground}`, () => ({ positions: grid(size, ground) })), colour: [0.42, 0.48, 0.55, 0.42], reach: 2.4 * size });
    if (this.raised) items.push({ kept: this.cached("column", column), model: mul(shifted([0, 0, ground]), [0.05 * size, 0, 0, 0, 0, 0.05 * size, 0, 0, 0, 0, robot.floor - ground, 0, 0, 0, 0, 1]), colour: [...COLUMN, 1], shadow: true });
    for (const { body, kept, colour, layer, pose: at } of this.shapes) {
      if (!shown[layer]) continue;
      const clear = layer === "inertia" || (shown.inertia && robot.dressed);
      items.push({ kept, model: mul(poseOf(poses, body), at), colour: [...(red.has(body) && layer === "looks" ? reddened(colour, robot) : colour), layer === "inertia" ? 0.3 : clear ? 0.35 : 1], shadow: layer === "looks", closed: layer === "inertia" });
    }
    if (shown.torques) this.torqueMarks(items);
    if (shown.frames) this.frameMarks(items);
    if (shown.com) this.comMarks(items, lines);
    if (this.stand && this.holds) this.footMarks(items, lines);
    if (shown.wrenches) this.wrenchMarks(items);
    if (robot.payload !== null) this.loadMarks(items);
    if (shown.ellipsoid || shown.polytope) this.forceMarks(items);
    if (shown.mass) this.massMarks(items);
    if (this.book) this.book.marks(items);
    this.grab.marks(items);
    this.layer?.marks(items);
    if (this.grasp.can) items.push({ kept: this.cached("knob", () => ball(8)), model: mul(shifted(this.grasp.tip), scaling(0.016 * size)), colour: [...robot.colours.grasp, 1], over: true });
    if (shown.path && this.path) lines.push({ kept: this.path, colour: [...this.seen(robot.colours.path), 0.9], strip: true });
    this.stage.draw(items, lines, ground, this.sticks(), fineness);
  }

  print(paper) { // paper takes no picture of the stage by itself: WebGL forgets what it has drawn
    this.draw();
    const { canvas, covered } = this.stage, seen = Math.round(canvas.width * (1 - covered.right / canvas.clientWidth));
    Object.assign(paper, { width: seen, height: canvas.height });
    paper.getContext("2d").drawImage(canvas, 0, 0);
  }

  sticks() { // from joint to joint, for where surfaces cannot be drawn
    const at = (body) => place(poseOf(this.poses, body)), tip = this.grasp.can ? [this.grasp.tip] : [];
    const sticks = this.robot.bodies.map(({ parent }, k) => [at(parent), at(k)]);
    if (tip.length) sticks.push([at(this.robot.frames[this.robot.tip].body), tip[0]]);
    return { sticks, ends: tip };
  }

  redBodies() { // moved by a joint that is over its limit
    const { over } = this;
    return new Set(this.robot.marks.filter(({ torque }) => over.has(torque)).map(({ body }) => body));
  }

  torqueMarks(items) {
    const shares = this.shares(), size = this.robot.size;
    for (const { torque, body, pose: at, turns, reversed } of this.robot.marks) {
      const share = shares[torque];
      if (!(Math.abs(share) > 0.004)) continue;
      const colour = [...this.colour(torque, share), 1], level = Math.min(1, Math.round(Math.abs(share) * 100) / 100) || 0.01;
      const T = mul(poseOf(this.poses, body), share > 0 ? at : mul(at, reversed));
      const scale = turns ? 0.105 * size : size;
      const over = this.robot.torques[torque].limit && isOver(share); // then a closed ring, or a stouter arrow: another shape, too
      const kept = turns ? (over ? this.cached("ring", () => ring(0.14)) : this.cached(`arc ${level}`, () => arc(5.4 * level, 0.075))) : this.cached(`force ${level} ${over}`, () => arrow(0.4 * level, over ? 0.016 : 0.008));
      items.push({ kept, model: mul(T, scaling(scale)), colour });
    }
  }

  frameMarks(items) {
    const length = 0.075 * this.robot.size, kept = this.cached("axis", () => arrow(1, 0.055));
    for (const { body, pose: at } of this.robot.frames) {
      const T = mul(poseOf(this.poses, body), at);
      this.robot.colours.axes.forEach((colour, k) => items.push({ kept, model: mul(T, mul(AXES[k], scaling(length))), colour: [...colour, 1] }));
    }
  }

  comMarks(items, lines) {
    const p = this.book?.centre ?? this.mechanics.centre(this.q); // of a page about one link, that of the link
    if (!p) return;
    const at = shifted(p), falls = this.stand && this.holds && !this.stand.stable(p), colour = falls ? this.red : this.seen(this.robot.colours.com);
    items.push({ kept: this.ball, model: mul(at, scaling(0.026 * this.robot.size)), colour: [...colour, 1], shadow: true, over: true });
    const low = shifted([p[0], p[1], this.robot.floor]), flat = scaling(0.02 * this.robot.size);
    flat[10] = 1e-4 * this.robot.size;
    items.push({ kept: this.ball, model: mul(low, flat), colour: [...colour, 0.7] });
  }

  get red() { const { shares } = this.robot.colours; return shares[shares.length - 1][1]; }

  footMarks(items, lines) { // the force of the floor at each contact, and the polygon around them
    const { stand, robot, support } = this, points = stand.points(this.q), weight = Math.max(1e-9, ...(support?.forces ?? []).map(norm));
    const corners = [...stand.hull, stand.hull[0]].flatMap(([x, y]) => [x, y, robot.floor + 2e-3 * robot.size]);
    const colour = stand.stable(this.mechanics.centre(this.q)) ? this.seen(robot.colours.path) : this.red;
    lines.push({ kept: this.cached("feet", () => ({ positions: new Float32Array(corners) })), colour: [...colour, 0.9], strip: true });
    (support?.forces ?? []).forEach((f, k) => {
      const length = Math.round((30 * norm(f)) / weight) / 100;
      if (length) items.push({ kept: this.cached(`push ${length}`, () => arrow(length, 0.014)), model: mul(mul(shifted(points[k]), alongZ(f)), scaling(robot.size)), colour: [...robot.colours.wrench, 1] });
    });
  }

  wrenchMarks(items) {
    for (const { frame, pose: at, length, turns } of this.robot.wrenchMarks) {
      const f = this.robot.frames[frame], T = mul(poseOf(this.poses, f.body), mul(f.pose, at));
      const kept = turns ? this.cached("moment", () => arc(4.4, 0.09)) : this.cached(`push ${length}`, () => arrow(length, 0.014));
      items.push({ kept, model: mul(T, scaling(turns ? 0.09 * this.robot.size : this.robot.size)), colour: [...this.robot.colours.wrench, 1] });
    }
  }

  loadMarks(items) { // what the sliders put on the tip
    const { robot, mechanics, shown } = this, p = place(mechanics.tipPose(this.q)), push = norm(mechanics.push);
    const radius = Math.cbrt((3 * mechanics.mass) / (4 * Math.PI * 7850)), { body, pose: at } = robot.payloadAt; // a ball of steel
    if (shown.looks && mechanics.mass) items.push({ kept: this.ball, model: mul(shifted(place(mul(poseOf(this.poses, body), at))), scaling(radius)), colour: [...robot.colours.payload, 1], shadow: true });
    if (!push) return;
    const length = Math.round(100 * Math.max(0.08, 0.35 * push / robot.push)) / 100, T = mul(shifted(p), alongZ(mechanics.push));
    items.push({ kept: this.cached(`push ${length}`, () => arrow(length, 0.014)), model: mul(T, scaling(robot.size)), colour: [...robot.colours.wrench, 1] });
  }

  forceMarks(items) { // both change with the pose, and only then
    const { robot, shown } = this;
    if (robot.tip === null || !robot.forceScale) return;
    if (!this.forces) {
      const columns = this.mechanics.tipColumns(this.q), p = place(this.mechanics.tipPose(this.q));
      const polytope = forcePolytope(robot, columns, this.mechanics.holding(this.q));
      if (this.solid) this.stage.forget(this.solid);
      this.solid = polytope && this.stage.keep(solidOf(polytope.facets));
      this.forces = { p, ellipsoid: forceEllipsoid(robot, columns), polytope };
    }
    const { p, ellipsoid } = this.forces, s = robot.forceScale, at = [s, 0, 0, p[0], 0, s, 0, p[1], 0, 0, s, p[2], 0, 0, 0, 1];
    if (shown.ellipsoid && ellipsoid) items.push({ kept: this.ball, model: mul(at, pose(ellipsoid, [0, 0, 0])), colour: [...robot.colours.ellipsoid, 0.35], closed: true });
    if (shown.polytope && this.solid) items.push({ kept: this.solid, model: at, colour: [...robot.colours.polytope, 0.22], closed: true });
  }

  // Masses at the tip along its principal axes; null where they are not known.
  weigh() {
    this.masses ??= this.mechanics.run.mass && effectiveMasses(this.mechanics.massMatrix(this.q), this.mechanics.tipColumns(this.q));
    return this.masses;
  }

  massMarks(items) {
    const { robot } = this, R = massEllipsoid(this.weigh(), robot.tipDirections, robot.massScale, 0.3 * robot.size);
    if (R) items.push({ kept: this.ball, model: pose(R, this.grasp.tip), colour: [...robot.colours.mass, 0.4], closed: true });
  }
}

const isOver = (share) => Math.abs(share) > 1 + 1e-6; // as the limit check of twistwrench
const reddened = (colour, { colours }) => colour.map((c, i) => 0.1 * c + 0.9 * colours.shares[colours.shares.length - 1][1][i]);

const GLIDE = 600; // ms, of the view when a robot is let go
const UNMOVED = matchMedia("(prefers-reduced-motion: reduce)");

const COLUMN = [0.55, 0.59, 0.64]; // of a pedestal

const REACH = 13; // moments of a motion that the view holds

const AXES = [[0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1], IDENTITY]; // z onto x, y, z

function grid(size, floor) { // lines a round length apart, under the robot and some way around
  const step = squareOf(size), count = Math.min(120, Math.ceil((2.5 * size) / step)), far = count * step, found = [];
  for (let k = -count; k <= count; k++) found.push(k * step, -far, floor, k * step, far, floor, -far, k * step, floor, far, k * step, floor);
  return new Float32Array(found);
}

function fail(words) { // instead of the robot
  document.querySelector("main").classList.remove("waiting");
  Object.assign(document.getElementById("failure"), { hidden: false, textContent: words });
}

unpack(document.getElementById("data").textContent)
  .then(({ robot, array }) => {
    window.viewer = new Viewer(robot, array);
    document.querySelector("main").classList.remove("waiting");
  })
  .catch((problem) => {
    fail(String(problem.message || problem));
    console.error(problem);
  });
