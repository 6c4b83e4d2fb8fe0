// The lists of a robot of many joints: the largest torques first, the others and the sliders folded by limb, and a filter.
"use strict";

const OPEN = 8; // torques that stay in sight

class Fold {
  constructor(panel) {
    this.panel = panel;
    const { limbs } = panel.viewer.robot, box = document.getElementById("filter");
    box.parentElement.hidden = false;
    box.addEventListener("input", () => this.arrange());
    this.box = box;
    this.first = document.querySelector("#torques ul");
    this.limbs = limbs.map((limb) => ({ ...limb, name: limb.name.replace(/_joint\b/g, ""), fold: this.folded("torques") }));
    this.limbs.forEach(({ name, hands }, k) => {
      if (!hands.length) return;
      const fold = this.folded("joints");
      fold.open = !k;
      fold.summary.textContent = `${name} (${hands.length})`;
      fold.list.append(...hands.map((hand) => panel.hands[hand].slider.closest("li")));
    });
  }

  folded(section) {
    const fold = document.getElementById(section).appendChild(document.createElement("details"));
    return Object.assign(fold, { summary: fold.appendChild(document.createElement("summary")), list: fold.appendChild(document.createElement("ul")) });
  }

  // Each torque's share of its limit: at the worst moment of a motion, else here.
  shares() {
    const { viewer } = this.panel, { robot, motion, posed } = viewer;
    return motion && !posed ? motion.peaks.map(({ value }, k) => Math.abs(value) / (robot.torques[k].limit || 1e9)) : viewer.shares().map(Math.abs);
  }

  arrange() {
    const { bars, hands } = this.panel, wanted = this.box.value.trim().toLowerCase(), shares = this.shares();
    const order = bars.map((_, k) => k).filter((k) => this.panel.viewer.shows(k)).sort((a, b) => shares[b] - shares[a]), row = (k) => bars[k].label.parentElement;
    const fits = (element) => element.title.toLowerCase().includes(wanted), open = new Set(wanted ? order.filter((k) => fits(bars[k].label)) : order.slice(0, OPEN));
    this.first.append(...[...open].map(row));
    for (const { name, torques, fold } of this.limbs) {
      const mine = order.filter((k) => torques.includes(k) && !open.has(k));
      fold.hidden = !mine.length || Boolean(wanted);
      fold.summary.textContent = mine.length ? `${name} (${mine.length}, up to ${Math.round(100 * shares[mine[0]])} %)` : "";
      fold.list.append(...mine.map(row));
    }
    hands.forEach(({ slider, name }) => { slider.closest("li").hidden = !fits(name); });
    document.querySelectorAll("#joints details").forEach((fold) => {
      fold.hidden = Boolean(wanted) && !fold.querySelector("li:not([hidden])");
      if (wanted) fold.open = true;
    });
  }
}
