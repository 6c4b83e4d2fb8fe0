// The panel, the play bar, and the switches: what is seen beside the robot, and what moves it.
"use strict";

class Panel {
  constructor(viewer) {
    this.viewer = viewer;
    const robot = viewer.robot;
    const of = (id) => document.getElementById(id);
    of("subtitle").textContent = `${robot.subtitle}, squares of ${squareOf(robot.size)} m${robot.held ? ` · ${robot.held}` : ""}`;
    this.torques = of("torques");
    this.answer = of("verdict");
    this.told = of("told");
    this.title = document.querySelector("#torques h2");
    this.stopped = of("stopped");
    this.stands = of("stands");
    this.afloat = robot.hands.some(({ turn: turns }) => turns !== undefined);
    this.bars = robot.torques.map((torque, k) => this.torqueRow(torque, k));
    this.hands = robot.hands.map((hand, k) => this.handRow(hand, k));
    of("joints").hidden = !robot.hands.length;
    if (robot.notes.length) {
      of("notes").hidden = false;
      robot.notes.forEach((text) => (of("notes").querySelector("ul").appendChild(document.createElement("li")).textContent = text));
    }
    robot.switches.forEach(([key, label]) => this.switch(key, label));
    this.load = new LoadPanel(this);
    this.fold = robot.limbs.length ? new Fold(this) : null;
    if (viewer.motion) this.playBar(of);
    const resized = new ResizeObserver(() => { this.cover(); viewer.compact?.fit(); viewer.request(); });
    [of("stage"), of("verdict"), document.querySelector("header")].forEach((part) => resized.observe(part));
  }

  cover() { // where the panel stands beside the stage, the view is in the middle of the rest
    const of = (id) => document.getElementById(id), compact = document.querySelector("main").classList.contains("compact"), narrow = window.innerWidth <= 640;
    if (compact) {
      const below = (part) => (part.offsetHeight ? part.offsetTop + part.offsetHeight : 0), foot = (part) => (part.offsetHeight ? part.offsetHeight + 10 : 0);
      of("verdict").style.top = narrow ? `${below(document.querySelector("header")) + 6}px` : "";
      const book = of("book").parentElement.tagName === "MAIN" ? of("book") : { offsetWidth: 0, offsetHeight: 0 };
      const bottom = foot(of("one")) + foot(of("player")) + (narrow ? foot(book) : 0), side = narrow || !book.offsetWidth ? 0 : book.offsetWidth + 12;
      const right = side || (narrow ? 0 : 0.6 * of("verdict").offsetWidth);
      this.viewer.stage.covered = { right, top: narrow ? below(of("verdict")) || below(document.querySelector("header")) : 0, bottom, foot: bottom, side };
      return;
    }
    of("verdict").style.top = "";
    const beside = window.innerWidth > 760 && !matchMedia("print").matches;
    const right = beside ? document.querySelector("aside").offsetWidth + 12 : 0;
    const bar = this.viewer.motion ? of("player").offsetHeight + 12 : 0;
    const shown = of("shown"), header = document.querySelector("header");
    shown.style.top = beside ? "" : `${header.offsetTop + header.offsetHeight + 6}px`; // below the title, however many lines it takes
    const top = beside || !shown.offsetHeight ? 0 : shown.offsetTop + shown.offsetHeight;
    this.viewer.stage.covered = { right, top, bottom: beside ? bar + shown.offsetHeight + 16 : 0 };
  }

  row(list, ...cells) {
    const row = document.createElement("li");
    cells.forEach((cell) => row.appendChild(cell));
    document.querySelector(`#${list} ul`).appendChild(row);
    return cells;
  }

  cell(kind, text = "") {
    const cell = document.createElement("span");
    cell.className = kind;
    cell.textContent = cell.title = text;
    return cell;
  }

  torqueRow({ name }, k) {
    const bar = this.cell("bar"), label = this.cell("name", name.replace(/_joint$/, "")), lines = this.viewer.robot.colours.lines;
    if (this.viewer.motion) Object.assign(label.style, { boxShadow: `inset 3px 0 ${lines[k % lines.length]}`, paddingLeft: "8px" });
    const fill = bar.appendChild(document.createElement("i"));
    bar.appendChild(document.createElement("b"));
    const [, , number, share] = this.row("torques", label, bar, this.cell("number"), this.cell("share"));
    const most = this.viewer.motion && bar.appendChild(document.createElement("u")); // the peak of the motion
    return { label, fill, number, share, most };
  }

  handRow({ name, lower, upper, v }, k) {
    const slider = document.createElement("input");
    const { loops } = this.viewer, follows = Boolean(loops?.dependent) && v.every((at) => loops.dependent[at]);
    Object.assign(slider, { type: "range", id: `hand-${k}`, min: lower, max: upper, step: "any", disabled: follows });
    slider.setAttribute("aria-label", name);
    slider.addEventListener("input", () => this.viewer.slide(k, Number(slider.value)));
    slider.addEventListener("change", () => this.viewer.settled());
    const shown = `${this.viewer.robot.book ? `${k + 1} ` : ""}${name.replace(/_joint$/, "")}`;
    const [label, , number] = this.row("joints", this.cell("name", shown), slider, this.cell("number"));
    return { slider, number, name: label };
  }

  grasp(k, value, from = this.viewer.q) { // q with one hand moved; three turns of a base that floats make its quaternion
    const hand = this.viewer.robot.hands[k], q = from.slice();
    if (hand.turn === undefined) q[hand.q] = value;
    else {
      const angles = this.angles(hand.q, q);
      angles[hand.turn] = value;
      q.splice(hand.q, 4, ...toQuaternion(...angles));
    }
    return q;
  }

  valueOf(k, q) { // of a slider
    const { q: at, turn: turns } = this.viewer.robot.hands[k];
    return turns === undefined ? q[at] : this.angles(at, q)[turns];
  }

  angles(at, q) { // roll, pitch and yaw of the quaternion there
    const R = fromQuaternion(q.slice(at, at + 4));
    return [Math.atan2(R[7], R[8]), Math.asin(Math.max(-1, Math.min(1, -R[6]))), Math.atan2(R[3], R[0])];
  }

  switch(key, label) {
    const button = document.getElementById(SWITCHES[key] ?? "shown").appendChild(document.createElement("button"));
    Object.assign(button, { textContent: label, id: `show-${key}`, title: this.meaning(key) });
    button.addEventListener("click", () => { this.show(key, !this.viewer.shown[key]); this.viewer.settled(); });
    this.show(key, this.viewer.shown[key]);
  }

  show(key, on) {
    this.viewer.shown[key] = on;
    this.viewer.changes += 1;
    if (key === "feet" && this.stands && this.viewer.poses) this.viewer.setCoordinates(this.viewer.closed(this.viewer.q));
    if (["stops", "drives"].includes(key) && this.viewer.fall) this.viewer.drop(this.viewer.fall.dq);
    this.load?.update();
    this.viewer.book?.explain();
    document.getElementById(`show-${key}`).setAttribute("aria-pressed", on);
  }

  meaning(key) { // what a mark's length says
    const { size, forceScale, massScale } = this.viewer.robot, square = squareOf(size), force = forceScale && saidScales(size, [[square / forceScale, "N"]]);
    const said = { torques: "300° of an arc, or the longest arrow, is the limit", ellipsoid: force, polytope: force, mass: massScale && saidScales(size, [[square / massScale, "kg"]]) };
    return said[key] || "";
  }

  playBar(of) {
    const viewer = this.viewer, { begin, end } = viewer.motion;
    of("player").hidden = false;
    document.querySelector("main").classList.add("playing");
    this.time = Object.assign(of("time"), { min: begin, max: end });
    this.clock = of("clock");
    this.play = of("play");
    this.play.addEventListener("click", () => this.toggle());
    this.time.addEventListener("input", () => { viewer.playing = false; viewer.seek(Number(this.time.value)); });
    this.time.addEventListener("change", () => viewer.settled());
    of("speed").addEventListener("change", (event) => { viewer.speed = Number(event.target.value); });
    document.addEventListener("keydown", (event) => {
      if (event.key !== " " || event.target.type === "text" || /^(BUTTON|SELECT)$/.test(event.target.tagName)) return;
      event.preventDefault();
      this.toggle();
    });
    this.strip = new Strip(viewer, of("history"));
  }

  toggle() {
    const viewer = this.viewer;
    viewer.playing = !viewer.playing;
    viewer.once = false;
    if (viewer.playing && viewer.posed) viewer.seek(viewer.time);
    if (!viewer.playing) viewer.address.note(false);
    this.update();
  }

  verdict() { // the word, and beside and below it why
    const { answer: verdict } = this.viewer, box = this.answer, [word, said] = box.querySelectorAll("b, span");
    box.hidden = !verdict;
    if (box.hidden) return;
    box.className = verdict.word.toLowerCase().replace(" ", "-");
    word.textContent = verdict.word;
    said.textContent = printed(verdict.lines.join("\n"));
    const note = box.querySelector("small");
    note.hidden = !verdict.note;
    note.textContent = verdict.note;
  }

  held() { // how loops or feet hold the robot
    const { viewer } = this, { stand, support, borne, mechanics, q } = viewer;
    if (!viewer.posed || !viewer.holds || viewer.fall) return "";
    if (borne) return borne.holds ? "Loops closed; torques of the joints with a motor." : "Loops closed; the joints with a motor cannot hold this pose.";
    if (!support) return stand.stable(mechanics.centre(q)) ? "Cannot stand so: the feet would slip or lift." : "Cannot stand so: its centre of mass is not above its feet.";
    const weight = number(Math.abs(support.forces.reduce((sum, f) => sum + f[2], 0)), 3);
    return `On its feet: the floor bears ${weight} N, shared by the forces of least norm, with friction ${stand.friction}${support.over ? "; only with torques over their limits" : ""}.`;
  }

  tell() { // to those who hear the page, once a slider rests; then the largest torques come first
    this.fold?.arrange();
    if (this.viewer.answer) this.told.textContent = printed(this.viewer.answer.text);
  }

  update() {
    const viewer = this.viewer, { robot, tau, q } = viewer, shares = viewer.shares();
    const peaks = viewer.motion ? viewer.motion.peaks : [], { over } = viewer;
    const largest = Math.max(...tau.map(Math.abs), ...peaks.map(({ value }) => Math.abs(value)), 1e-3);
    const digits = viewer.fall && !viewer.book && !viewer.drives ? 0 : Math.min(4, Math.max(1, 2 - Math.floor(Math.log10(largest))));
    const { book } = viewer;
    this.torques.hidden = !robot.torques.length || (book && !book.found.tau);
    this.title.textContent = book ? book.found.title || "" : viewer.drives ? "Torques of the drives" : viewer.fall ? "Torques: none, let go" : !viewer.posed ? "Torques of the motion" : this.afloat && !viewer.support ? "Torques and wrench on the base that hold this pose" : "Torques that hold this pose";
    this.stopped.textContent = viewer.stopped ? "Stopped: no closed pose is found beyond." : "";
    this.stands.textContent = this.held();
    this.verdict();
    this.load.update();
    if (this.fold && !this.arranged) { this.arranged = true; this.fold.arrange(); }
    this.bars.forEach(({ label, fill, number, share, most }, k) => {
      const x = shares[k], wide = 50 * Math.min(1, Math.abs(x)), limit = robot.torques[k].limit;
      Object.assign(fill.style, { left: `${x < 0 ? 50 - wide : 50}%`, width: `${wide}%`, background: css(viewer.colour(k, x)) });
      number.textContent = `${signed(tau[k], digits)} ${robot.torques[k].unit}`;
      share.textContent = limit ? `${Math.round(100 * Math.abs(x))} %` : "";
      share.className = limit && isOver(x) ? "share over" : "share";
      label.classList.toggle("over", over.has(k));
      label.parentElement.hidden = !viewer.shows(k);
      if (!most) return;
      const peak = limit ? peaks[k].value / limit : 0;
      Object.assign(most.style, { left: `${Math.max(0, Math.min(99, 50 + 50 * peak))}%`, display: limit && !viewer.posed ? "" : "none" });
      most.className = isOver(peak) ? "over" : "";
    });
    this.hands.forEach(({ slider, number }, k) => {
      const hand = robot.hands[k], value = this.valueOf(k, q);
      if (document.activeElement !== slider || !viewer.posed || viewer.stopped) slider.value = value;
      number.textContent = hand.unit === "°" ? `${signed((value * 180) / Math.PI, 1)}°` : `${signed(value, 3)} m`;
      number.className = (hand.least !== null && value < hand.least - 1e-9) || (hand.most !== null && value > hand.most + 1e-9) ? "number over" : "number";
    });
    if (!this.time) return;
    this.time.value = viewer.time;
    this.clock.textContent = viewer.fall ? "let go" : viewer.posed ? "posed by hand" : `${viewer.motion.shown(viewer.time).toFixed(2)} / ${viewer.motion.shown(viewer.motion.end).toFixed(2)} s`;
    this.play.textContent = viewer.playing ? "❚❚" : "▶";
    this.play.setAttribute("aria-label", viewer.playing ? "Pause" : "Play");
  }
}

const SWITCHES = { keep: "of-joints", stops: "of-fall", drives: "of-fall", feet: "of-joints" }; // where those stand that are not about what is drawn
const printed = (text) => text.replace(/(^|[\s(±=])-(?=[\d.])/g, "$1−"); // with the minus of print
const css = (colour) => `rgb(${colour.map((c) => Math.round(255 * c)).join(" ")})`;
const signed = (x, digits) => (Number(x.toFixed(digits)) === 0 ? (0).toFixed(digits) : x.toFixed(digits).replace("-", "−"));
