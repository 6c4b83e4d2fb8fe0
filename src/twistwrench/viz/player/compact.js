// The page without its panel, for a small screen or within another page: the robot, the verdict, one control and the play bar.
"use strict";

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
    const decide = () => this.set(this.embedded || (this.wanted && narrow.matches && !robot.book));
    narrow.addEventListener("change", decide);
    this.link.addEventListener("click", (event) => this.leave(event));
    decide();
  }

  get parts() { // the verdict, and the control that is named, or the first there is
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
    if (on) {
      const places = [main, document.querySelector("#one ul")];
      for (const part of this.parts) {
        this.homes.push([part, part.parentNode, part.nextSibling]);
        places[/^(LI|P)$/.test(part.tagName) ? 1 : 0].appendChild(part);
      }
      this.link.textContent = this.embedded ? "Open full" : "All controls";
    } else this.link.textContent = "One control";
    this.viewer.panel.cover();
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
