// The verdict on the motion under what is set now: the sentences of `twistwrench torques`, with this page's numbers.
"use strict";

class Verdict {
  constructor(motion, robot) {
    Object.assign(this, { motion, robot, data: motion.data.verdict });
    this.names = [...robot.torques, ...motion.followers.map(({ joint }) => ({ name: joint }))].map(({ name }) => name);
  }

  say(name, words = {}) { return this.data.sentences[name].replace(/\{(\w+)\}/g, (_, key) => words[key]); }

  time(row) { return seconds(this.motion.shown(this.motion.time[row])); }

  joints() { // each with its peak, as the command counts it: noise of the log taken off, and its reach
    const { peaks, limits } = this.motion, noise = this.data.joints;
    return peaks.map(({ value, row }, k) => {
      const { chance, reach, end, sigma } = noise ? noise[k] : { chance: 0, reach: 0, end: false, sigma: 0 }, peak = value + chance;
      return { k, joint: this.names[k], unit: this.robot.torques[k].unit, limit: limits[k], largest: value, row, peak, reach, end, sigma, share: Math.abs(peak) / limits[k] };
    });
  }

  because({ k, row, largest }) {
    const along = Object.entries(this.motion.terms(row, k)).map(([name, x]) => [name, x * Math.sign(largest)]);
    const [name, most] = along.reduce((a, b) => (b[1] > a[1] ? b : a)), total = along.reduce((sum, [, x]) => sum + Math.max(0, x), 0);
    return this.say("because", { cause: this.data.words.causes[name], share: percent(total ? most / total : 0) });
  }

  torqueInWords(j, scale) {
    const { negligible, small } = this.data.bounds, known = Number.isFinite(j.limit) ? j.limit : 0;
    const doubts = j.reach > negligible * Math.max(Math.abs(j.peak), small * Math.max(known, scale));
    return this.say("over", {
      joint: j.joint, time: this.time(j.row), peak: torqueText(j.peak), doubt: doubts ? this.say("doubt", { sigma: deviation(j.reach) }) : "",
      unit: j.unit, limit: number(j.limit), share: percentOfLimit(j.share), because: this.because(j),
    });
  }

  passed() { // limits of position, and of the velocity that the speed makes
    const { motion, data, names } = this, found = data.passed.map((e) => ({ ...e, time: motion.shown(e.time) }));
    data.velocities.forEach((limit, k) => {
      if (limit < 0 || data.noisy.includes(names[k])) return;
      let worst = { by: -Infinity };
      motion.dq.forEach((dq, i) => {
        const value = motion.pace * dq[k], by = Math.abs(value) - limit;
        if (by > worst.by) worst = { by, value, time: motion.shown(motion.time[i]) };
      });
      if (worst.by > data.bounds.tolerance * limit) found.push({ joint: names[k], kind: "velocity", value: worst.value, limit, time: worst.time, angular: data.turns[k] });
    });
    const rank = (e) => (e.limit ? -Math.abs(e.value / e.limit) : 0);
    return found.sort((a, b) => (a.kind === b.kind ? rank(a) - rank(b) : a.kind < b.kind ? -1 : 1)).map((e) => {
      const speed = e.kind === "velocity", by = speed ? Math.abs(e.value) - e.limit : Math.abs(e.value - e.limit);
      const unit_ = `${e.angular ? "rad" : "m"}${speed ? "/s" : ""}`;
      return { joint: e.joint, kind: this.data.words.kinds[e.kind], text: this.say("motion", { joint: e.joint, time: seconds(e.time), kind: this.data.words.kinds[e.kind], by: number(by, 3), unit: unit_, value: number(e.value, 5), limit: number(e.limit, 5) }) };
    });
  }

  grouped(over) { // a sentence on the worst, and the names of the others
    if (!over.length) return [];
    const [first] = over, others = new Map();
    over.slice(1).forEach(({ joint, kind }) => {
      const kinds = others.get(joint) ?? others.set(joint, []).get(joint);
      if (!kinds.includes(kind) && !(joint === first.joint && kind === first.kind)) kinds.push(kind);
    });
    const rest = [...others].filter(([, kinds]) => kinds.length).map(([joint, kinds]) => this.say("other", { joint, kinds: kinds.join(", ") }));
    return [first.text, ...(rest.length ? [this.say("also", { others: listed(rest, 4) })] : [])];
  }

  loaded(peaks) { // joints that a motor drives and a torque loads
    const size = Array.from(peaks, Math.abs), most = Math.max(0, ...size);
    return size.map((x, k) => this.data.driven[k] && x > this.data.bounds.loaded * most);
  }

  limitDoubts(joints) {
    const { words, placeholders } = this.data, loaded = this.loaded(joints.map(({ peak }) => peak)), count = loaded.filter(Boolean).length;
    const missing = joints.filter(({ k, limit }) => loaded[k] && limit === Infinity).map(({ joint }) => joint), said = [];
    const named = missing.length === count ? "" : ` (${listed(missing, 6)})`;
    const which = count > 1 ? this.say("some", { count: missing.length, all: count, named }) : this.say("one", { joint: missing[0] });
    if (missing.length) said.push(this.say("unlimited", { joints: which, remedy: words.remedy }));
    if (placeholders.words && loaded.some((on, k) => on && !placeholders.confirmed[k])) said.push(placeholders.words);
    return said;
  }

  mimics(joints) { // those beyond their limits, and those of which noise leaves it open
    const { followers, most } = this.motion, { bounds, words } = this.data, over = [], open = [];
    followers.map((f, k) => ({ ...f, ...most[k], share: Math.abs(most[k].value) / f.limit })).sort((a, b) => b.share - a.share).forEach((f) => {
      if (!(Math.abs(f.value) - f.limit > bounds.tolerance * f.limit)) return;
      const reach = f.ratio ? joints[f.leader].reach / f.ratio : 0, takes = { joint: f.joint, peak: torqueText(f.value), unit: f.unit, limit: number(f.limit), share: percentOfLimit(f.share) };
      if (Math.abs(f.value) - bounds.confidence * reach > f.limit) over.push({ joint: f.joint, kind: words.kinds.effort, text: this.say("follower", { ...takes, leader: this.names[f.leader], time: this.time(f.row) }) });
      else open.push(this.say("open follower", takes));
    });
    return { over, open };
  }

  force(joints) { // in words, what a floating base lacks; empty where that is next to nothing
    const { force } = this.data;
    if (!force) return "";
    const mass = force.mass + this.motion.mechanics.mass, weight = mass * force.strength;
    const largest = Math.max(0, ...force.rows.map((k) => joints[k]).filter(({ unit }) => unit === "N").map(({ peak, sigma }) => Math.abs(peak) - force.sure * sigma));
    if (!(largest > Math.max(force.share * weight, force.least * mass))) return "";
    return this.say("force", { force: number(largest), share: weight ? this.say("of weight", { share: percent(largest / weight) }) : "" });
  }

  nearest(joints, scale) {
    const { bounds, asLogged, gap } = this.data, limited = joints.filter(({ limit }) => limit < Infinity);
    if (!limited.length) return this.say("no motor");
    const j = limited.reduce((a, b) => (b.share > a.share ? b : a));
    if (Math.abs(j.largest) <= bounds.zero * scale) return this.say("no torque");
    const sure = asLogged ? this.say("sure", { share: percent((bounds.interval * j.reach) / j.limit, 2) }) : "";
    const said = [this.say("nearest", { joint: j.joint, share: percentOfLimit(j.share), sure, time: this.time(j.row), because: this.because(j) })];
    for (const { kind, joint, share, time, least } of this.data.near) {
      const here = kind === "velocity" ? share * this.motion.pace : share;
      if (here > Math.max(j.share, least)) said.push(this.say("near", { kind: kind[0].toUpperCase() + kind.slice(1), joint, share: percentOfLimit(here), time: seconds(this.motion.shown(time)) }));
    }
    if (asLogged) said.push(this.say("smoothed", { joints: asLogged }));
    if (gap) said.push(gap.words[0].toUpperCase() + gap.words.slice(1));
    return said.join(". ");
  }

  assumed(mass) { // a payload at the default tip is an assumption, one at a chosen tip is not
    const { empty, loaded, tip } = this.data.assumed;
    return mass && this.motion.mechanics.robot.payloadFrame === tip ? loaded.replace("{mass}", number(mass)) : empty;
  }

  // The word, its lines, the joints over their limits, and the largest payload that all limits of torque allow.
  judge() {
    const { motion, data } = this, { mass } = motion.mechanics, { bounds, gap, doubts } = data, joints = this.joints();
    const scale = Math.max(0, ...joints.map(({ largest }) => Math.abs(largest))), over = [], open = [];
    const limited = joints.filter(({ limit }) => limit < Infinity).sort((a, b) => b.share - a.share);
    for (const j of limited) {
      const reach = bounds.confidence * j.reach, passes = Math.abs(j.largest) - j.limit > bounds.tolerance * j.limit;
      if (passes && Math.abs(j.peak) - reach > j.limit) over.push({ ...j, kind: data.words.kinds.effort, text: this.torqueInWords(j, scale) });
      else if ((Math.abs(j.peak) + reach) / j.limit > 1 + bounds.tolerance && (reach > 0 || passes))
        open.push(this.say("open", { joint: j.joint, end: j.end ? this.say("end") : "", peak: torqueText(j.peak), sigma: deviation(j.reach), unit: j.unit, limit: number(j.limit) }));
    }
    const margin = motion.mechanics.robot.payload === null || !data.margin ? null : motion.margin((peaks) => this.loaded(peaks), data.leastPerKilogram);
    const mimics = this.mimics(joints), force = this.force(joints), lacks = force ? [this.say("no contact", { words: force[0].toLowerCase() + force.slice(1) })] : [];
    const hides = gap && gap.hidden > (limited.some(({ share }) => share > bounds.near) ? 0 : gap.most / motion.pace);
    const passed = this.passed(), hangs = doubts.first.length && !passed.length ? this.grouped([...over, ...mimics.over]).slice(0, 1).map((excess) => this.say("hangs", { word: "OVER LIMIT", excess })) : [];
    const unsure = [...doubts.first, ...hangs, ...this.limitDoubts(joints), ...open, ...mimics.open, ...doubts.before, ...lacks, ...(hides ? [gap.words] : []), ...doubts.after];
    const stated = this.grouped(doubts.first.length ? passed : [...over, ...mimics.over, ...passed]);
    const ranked = [["LOOK AGAIN", data.lookAgain], ["COLLISION", []], ["OVER LIMIT", stated], ["UNSURE", unsure]];
    const [word, reasons] = ranked.map(([word, said]) => [word, [...said, ...(data.clearance[word] ?? [])]]).find(([, said]) => said.length) ?? ["OK", []];
    const lightens = word === "OVER LIMIT" && ![...passed, ...mimics.over, ...unsure, ...Object.values(data.clearance).flat()].length; // a smaller payload alone is enough
    const assumed = word === "OK" ? this.assumed(mass) : "";
    const [first, ...others] = reasons.length ? reasons : [this.nearest(joints, scale)], lines = [`: ${first}${assumed}.`, ...others.map((reason) => `  - ${reason}.`)];
    const certain = word === "OK" || word === "OVER LIMIT", agrees = margin && (margin.mass >= mass) !== (mimics.over.length + mimics.open.length > 0 || limited.some((j) => Math.abs(j.largest) - j.limit > bounds.tolerance * j.limit));
    if (mass && certain && agrees) lines.push(this.say("margin", { mass: roundedDown(margin.mass), frame: motion.mechanics.robot.payloadFrame, joint: this.names[margin.joint], time: this.time(margin.row) }));
    lines.push(...data.closest, ...data.questions);
    if (force) lines.push(`${data.force.question} ${this.say("contact", { words: force })}`);
    return { word, lines, text: word + lines.join("\n"), over: new Set(limited.filter((j) => j.share > 1 + bounds.tolerance).map(({ k }) => k)), margin, lightens, note: data.joints && this.moved ? "Intervals are those of the command's load and speed." : "" };
  }

  // What the command said, where the page cannot judge another load.
  carried() {
    const { data, moved } = this, whose = data.text ? "As computed for the command's load at its own speed" : "Not judged here";
    const note = `${whose}, since ${data.fixed}.${moved ? " Torques below are those of the sliders." : ""}`;
    const [first, ...lines] = (data.text ?? "").split("\n"), [word] = /^[A-Z ]+/.exec(first) ?? [""];
    const over = new Set(this.joints().filter((j) => j.share > 1 + data.bounds.tolerance).map(({ k }) => k));
    return { word, lines: [first.slice(word.length), ...lines], text: data.text ?? "", over, margin: null, note };
  }

  get moved() { const { pace, mechanics, data } = this.motion; return pace !== 1 || mechanics.mass !== data.mass || mechanics.push.some((x) => x); }

  get now() { return this.data.fixed === null ? this.judge() : this.carried(); }
}
