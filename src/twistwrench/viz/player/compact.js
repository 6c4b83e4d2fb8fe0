// The page without its panel, for a small screen or within another page: the robot, the verdict, one control and the play bar.
"use strict";

const FITS = 12; // steps to the nearest view
const BEHIND = 0.7; // share of the controls' height that the lowest places may lie behind
const LOW = 0.2; // elevation [rad] in a frame, whose height is for the robot and not for the floor
const TURNS = [0, 0.2, -0.2, 0.4, -0.4, 0.6, -0.6]; // of the azimuth [rad] from the usual one
const SEEN = 0.6; // share of a page within another from which it is looked at

class Compact {
  constructor(viewer) {
    this.viewer = viewer;
    const { robot } = viewer, words = location.hash.slice(1).split("&"), narrow = matchMedia("(max-width: 899px)");
    this.embedded = words.includes("embed") || (Boolean(robot.embed) && !words.includes("full"));
    this.wanted = !words.includes("full");
    this.link = document.getElementById("open-full");
    this.hint = document.getElementById("hint");
    this.hint.textContent = `${/Mac|iPhone|iPad/.test(navigator.platform) ? "⌘" : "Ctrl"} + scroll to zoom`;
    viewer.stage.hint = () => this.tell();
    this.homes = []; // where parts of the panel belong
    this.usual = viewer.stage.home.azimuth;
    viewer.compact = this;
    const decide = () => this.set(this.embedded || (this.wanted && narrow.matches && !robot.book));
    narrow.addEventListener("change", decide);
    this.link.addEventListener("click", (event) => this.leave(event));
    decide();
    if (this.embedded && window.parent !== window && viewer.motion) this.playOnce();
  }

  playOnce() { // when most of a page within another is first seen
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    const { viewer } = this, watch = new IntersectionObserver(([{ intersectionRatio }]) => {
      if (intersectionRatio < SEEN) return;
      watch.disconnect();
      if (!viewer.posed) Object.assign(viewer, { playing: true, once: true });
    }, { threshold: SEEN });
    watch.observe(document.querySelector("main"));
  }

  // The view as near as the robot's motion allows, from the direction of those around the usual one that shows the robot tallest.
  fit() {
    const { stage, book, address, poses, robot } = this.viewer, { canvas, home } = stage;
    if (!this.embedded || book || stage.distance !== home.distance || !canvas.clientHeight) return;
    const bodies = [[0, 0, 0], ...robot.bodies.map((_, k) => place(poseOf(poses, k)))], turned = stage.azimuth !== home.azimuth || stage.elevation !== home.elevation;
    const from = { target: stage.target, distance: stage.distance }, reach = this.viewer.reach;
    const views = (turned ? [[stage.azimuth, stage.elevation]] : TURNS.map((turn) => [this.usual + turn, LOW])).map(([azimuth, elevation]) => {
      Object.assign(stage, from, { azimuth, elevation });
      this.approach(reach);
      const y = stage.projected(bodies).map((p) => p[1]);
      return { azimuth, elevation, target: stage.target.slice(), distance: stage.distance, tall: Math.max(...y) - Math.min(...y) };
    });
    const { tall, ...view } = views.reduce((best, each) => (each.tall > 1.01 * best.tall ? each : best)); // the first of equals is the usual one
    Object.assign(stage, view);
    Object.assign(home, view, { target: view.target.slice() }, turned ? { azimuth: home.azimuth, elevation: home.elevation } : {});
    this.viewer.request();
    address.first.camera.splice(0, 6, home.azimuth, home.elevation, home.distance, ...home.target);
  }

  approach(reach) { // until the motion fills what nothing covers; its lowest places may lie behind the controls
    const { stage } = this.viewer, { clientWidth: width, clientHeight: height } = stage.canvas, seen = (id) => document.getElementById(id).getBoundingClientRect(), edge = 0.03 * height;
    const verdict = seen("verdict"), title = document.querySelector("header").getBoundingClientRect().bottom, control = seen("one").top || seen("player").top || height, above = verdict.width > 0.6 * width;
    const left = 1.5 * edge, right = verdict.width && !above ? verdict.left - edge : width - 1.5 * edge, top = (above ? verdict.bottom + edge : title) + edge, bottom = control + BEHIND * (height - control);
    for (let k = 0; k < FITS; k++) {
      const places = stage.projected(reach), axis = (i) => places.map((p) => p[i]), [x, y] = [axis(0), axis(1)];
      const [wide, high] = [Math.max(...x) - Math.min(...x), Math.max(...y) - Math.min(...y)], { right: along, up } = stage.camera(), metre = stage.metre(stage.target);
      const off = [(Math.max(...x) + Math.min(...x) - left - right) / 2, (Math.max(...y) + Math.min(...y) - top - bottom) / 2];
      stage.target = add(stage.target, add(times(off[0] / metre, along), times(-off[1] / metre, up)));
      stage.distance *= Math.max(wide / (right - left), high / (bottom - top));
    }
  }

  get parts() { // the verdict, and the control that is named, or the first there is; none beside a motion that is not judged
    if (this.viewer.motion && !this.viewer.motion.data.judged) return [];
    const { robot } = this.viewer, name = robot.control ?? "", joint = name.startsWith("q:") ? robot.hands.findIndex((hand) => hand.name === name.slice(2)) : -1;
    const named = { payload: "payload", push: "push-z", speed: "pace", fall: "let-go", section: "book" }[name] ?? (joint >= 0 ? `hand-${joint}` : null);
    const id = [named, ...(robot.book ? ["book"] : []), "payload", "pace", "hand-0"].find((found) => found && document.getElementById(found)), found = document.getElementById(id);
    return [document.getElementById("verdict"), found && (found.closest("li, p") ?? found)].filter(Boolean);
  }

  set(on) {
    const main = document.querySelector("main");
    main.classList.toggle("compact", on);
    main.classList.toggle("embedded", on && this.embedded);
    this.viewer.stage.visit(this.embedded || window.parent !== window);
    this.homes.reverse().forEach(([part, parent, next]) => parent.insertBefore(part, next));
    this.homes = [];
    const book = document.getElementById("book");
    if (on) book.tabIndex = 0; // it scrolls by itself
    else book.removeAttribute("tabindex");
    if (on) {
      const places = [main, document.querySelector("#one ul")];
      for (const part of this.parts) {
        this.homes.push([part, part.parentNode, part.nextSibling]);
        places[/^(LI|P)$/.test(part.tagName) ? 1 : 0].appendChild(part);
      }
      this.link.textContent = this.embedded ? "Open full" : "All controls";
    } else this.link.textContent = "One control";
    this.viewer.panel.cover();
    this.fit();
    this.viewer.changes += 1;
  }

  tell() { // for a moment, how to zoom in a page within another
    this.hint.hidden = false;
    clearTimeout(this.told);
    this.told = setTimeout(() => { this.hint.hidden = true; }, 1500);
  }

  leave(event) { // a page within another opens in a window of its own; a small one shows its panel
    const { address } = this.viewer, words = address.words.filter((word) => word !== "embed" && word !== "full");
    this.link.href = `#${[...words, "full", written(address.state, address.first)].filter(Boolean).join("&")}`;
    if (this.embedded && location.protocol !== "about:") return;
    event.preventDefault();
    this.wanted = !this.wanted;
    this.set(this.wanted);
  }
}
