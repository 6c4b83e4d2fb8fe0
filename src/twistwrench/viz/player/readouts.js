// What the pages of the book's sections compute, by the number of the section: tables, numbers, torques, and arrows. MR.
"use strict";

const dot6 = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const apply6 = (G, V) => [0, 1, 2, 3, 4, 5].map((i) => dot6(V, G.slice(6 * i, 6 * i + 6)));
const columnsOf = (first, second, one, two) => [...["x", "y", "z"].map((k) => [`${first}<sub>${k}</sub>`, one]), ...["x", "y", "z"].map((k) => [`${second}<sub>${k}</sub>`, two])];
const TWIST = columnsOf("ω", "v", "rad/s", "m/s"), CHANGE = columnsOf('<i class="dot low">ω</i>', '<i class="dot low">v</i>', "rad/s²", "m/s²"), WRENCH = columnsOf("m", "f", "N m", "N");
const V_ = "<i>V</i>", F_ = "<i>F</i>", G_ = "<i>G</i>", DV_ = '<i class="dot">V</i>', sub_ = (letter, index) => `${letter}<sub>${index}</sub>`;

function wrenchMoved(T, F) { // [Ad of T^-1]' F: F given in {b}, in {s}, with T = T_sb. MR (3.98)
  const m = turn(T, F.slice(0, 3)), f = turn(T, F.slice(3)), p = place(T);
  return [...add(m, cross(p, f)), ...f];
}

function gyroscopic(G, V) { // -[ad_V]' G V. MR (8.40)
  const P = apply6(G, V), [m, f, w, v] = [P.slice(0, 3), P.slice(3), V.slice(0, 3), V.slice(3)];
  return [...add(cross(w, m), cross(v, f)), ...cross(w, f)];
}

const most = (m, k) => m.robot.book.inputs.find(({ key }) => key === "wrench").rows[k].most; // of a slider of the wrench
const joints = (m) => m.robot.torques.map((_, k) => k + 1);
const jointColumns = (m, unit_) => joints(m).map((k) => [k, unit_]);
const rowsOf = (A, names, n) => names.map((name, i) => [name, Array.from(A.slice(n * i, n * (i + 1)))]);

// The link that is chosen: its constants, pose, twist, and what moves with it.
function linkOf(m, { q, dq, ddq, chosen: k }) {
  const { inertia, axis } = m.robot.book.links[k];
  return { k, G: inertia, A: axis, T: m.poses(q)[k], V: Array.from(m.run[`V${k}`](q, dq)), dV: Array.from(m.run[`dV${k}`](q, dq, ddq)) };
}

const READOUTS = {
  "3.4": (m, { q, dq, wrench }) => {
    const T = m.tipPose(q), V_b = Array.from(m.run.twist_b(q, dq)), V_s = Array.from(m.run.twist_s(q, dq)), F_s = wrenchMoved(T, wrench);
    return {
      tables: [
        { caption: "Twist of the tip", columns: TWIST, rows: [[sub_(V_, "b"), V_b], [sub_(V_, "s"), V_s]] },
        { caption: "Wrench that the tip applies", columns: WRENCH, rows: [[sub_(F_, "b"), wrench], [sub_(F_, "s"), F_s]] },
      ],
      values: [["power, by the numbers in {b}", dot6(V_b, wrench), "W"], ["power, by the numbers in {s}", dot6(V_s, F_s), "W"]],
      frames: [["{s}", IDENTITY], ["{b}", T]],
      arrows: [
        { name: "velocity v", p: place(T), along: turn(T, V_b.slice(3)), most: 1.5, colour: 0 },
        { name: "angular velocity ω", p: place(T), along: turn(T, V_b.slice(0, 3)), most: 4, colour: 1 },
        { name: "force f", p: place(T), along: turn(T, wrench.slice(3)), most: most(m, 3), colour: 5 },
        { name: "moment m", p: place(T), along: turn(T, wrench.slice(0, 3)), most: most(m, 0), colour: 3 },
      ],
    };
  },

  "5.1": (m, { q, dq }) => {
    const n = dq.length, names = TWIST.map(([name]) => name), columns = m.tipColumns(q), p = place(m.tipPose(q));
    const longest = Math.max(1e-9, ...columns.map(norm));
    return {
      tables: [
        { caption: "Body Jacobian J<sub>b</sub>, a column for each joint [rad, m per rad or m]", columns: jointColumns(m, ""), rows: rowsOf(m.run.jacobian_b(q), names, n), heat: true },
        { caption: "Space Jacobian J<sub>s</sub>", columns: jointColumns(m, ""), rows: rowsOf(m.run.jacobian_s(q), names, n), heat: true },
        { caption: "Twist of the tip, in {b}", columns: TWIST, rows: [[sub_(V_, "b"), Array.from(m.run.twist_b(q, dq))]] },
      ],
      arrows: columns.map((along, k) => ({ name: `joint ${k + 1}`, p, along, most: longest, colour: k })),
    };
  },

  "5.2": (m, { q, wrench }) => {
    const n = m.robot.torques.length, J = m.run.jacobian_b(q), tau = Array.from(m.run.statics(q, wrench)), T = m.tipPose(q);
    const products = joints(m).map((name, k) => [name, [...wrench.map((F, i) => J[n * i + k] * F), tau[k]]]);
    return {
      tables: [{ caption: "Products of column i of J<sub>b</sub> with F<sub>b</sub>, and their sum [N m; sliding joints: N]", columns: [...WRENCH.map(([name]) => [name, ""]), ["<i>τ</i><sub>i</sub>", ""]], rows: products, heat: true }],
      tau, title: "Torques of the wrench", frames: [["{b}", T]],
      arrows: [
        { name: "force f", p: place(T), along: turn(T, wrench.slice(3)), most: most(m, 3), colour: 5 },
        { name: "moment m", p: place(T), along: turn(T, wrench.slice(0, 3)), most: most(m, 0), colour: 3 },
      ],
    };
  },

  "8.1.2": (m, { q, dq, chosen }) => {
    const n = dq.length, gamma = m.run.christoffel(q, ...m.load), c = Array.from(m.run.coriolis(q, dq, ...m.load));
    const at = (i, j, k) => gamma[n * (n * i + j) + k] * dq[j] * dq[k];
    const term = (i, j, k) => (j === k ? at(i, j, j) : at(i, j, k) + at(i, k, j)), all = dq.map((_, k) => k);
    const squares = c.map((_, i) => all.reduce((sum, j) => sum + at(i, j, j), 0));
    const mixed = c.map((_, i) => all.reduce((sum, j) => sum + all.slice(j + 1).reduce((part, k) => part + term(i, j, k), 0), 0));
    return {
      tables: [
        { caption: `Terms of c<sub>${chosen + 1}</sub>: row j, column k; squares on the diagonal [${m.robot.torques[chosen].unit}]`, columns: jointColumns(m, ""), rows: all.map((j) => [j + 1, all.map((k) => (k < j ? null : term(chosen, j, k)))]), heat: true },
        { caption: "Their sums for every joint [N m; sliding joints: N]", columns: jointColumns(m, ""), rows: [["centripetal", squares], ["Coriolis", mixed], ["<i>c</i><sub>i</sub>", c]] },
      ],
      tau: c, title: "Torques c of these velocities", arrows: [],
    };
  },

  "8.1.3": (m, { q }) => {
    const n = m.robot.torques.length, M = m.massMatrix(q), masses = effectiveMasses(M, m.tipColumns(q)), kind = ["x", "y", "z"];
    return {
      tables: [
        { caption: "Mass matrix M(θ) [kg m²; sliding joints: kg]", columns: jointColumns(m, ""), rows: rowsOf(M, joints(m), n), heat: true },
        { caption: "Tip: effective mass along its principal axes, in the axes of {s}", columns: [["mass", "kg"], ...kind.map((k) => [k, ""])], rows: masses.map(({ mass, axis }, k) => [["lightest", "middle", "heaviest"][k], [mass, ...axis]]) },
      ],
      arrows: [],
    };
  },

  "8.2": (m, state) => {
    const { G, T, V, dV } = linkOf(m, state), P = apply6(G, V), GdV = apply6(G, dV), rest = gyroscopic(G, V), F = add(GdV, rest), p = place(T);
    return {
      tables: [
        { caption: "Twist, in {b}", columns: TWIST, rows: [[sub_(V_, "b"), V]] },
        { caption: "Its rate", columns: CHANGE, rows: [[sub_(DV_, "b"), dV]] },
        { caption: "Momentum P<sub>b</sub>, angular and linear", columns: columnsOf("L", "p", "N m s", "N s"), rows: [["<i>P</i><sub>b</sub>", P]] },
        { caption: "Wrench, as the sum of its parts", columns: WRENCH, rows: [[`${G_}${DV_}`, GdV], [`−[ad]<sup>T</sup>${G_}${V_}`, rest], [sub_(F_, "b"), F]] },
        { caption: "Spatial inertia G<sub>b</sub> [kg m², kg m, kg]", columns: ["ω<sub>x</sub>", "ω<sub>y</sub>", "ω<sub>z</sub>", "v<sub>x</sub>", "v<sub>y</sub>", "v<sub>z</sub>"].map((name) => [name, ""]), rows: rowsOf(G, WRENCH.map(([name]) => name), 6), heat: true },
      ],
      frames: [["{b}", T]],
      values: [["kinetic energy ½ Vᵀ G V", dot6(V, P) / 2, "J"]],
      arrows: [
        { name: "velocity of its origin", p, along: turn(T, V.slice(3)), most: 1.5, colour: 0 },
        { name: "total force on it", p, along: turn(T, F.slice(3)), most: m.robot.push, colour: 5 },
      ],
    };
  },

  "8.3": (m, state) => {
    const { q, dq, ddq, wrench } = state, { k, G, A, T, V, dV } = linkOf(m, state), F = m.run.wrenches(q, dq, ddq, wrench);
    const up = turnedBack(T, times(-1, m.robot.book.gravity)), lifted = add(dV, [0, 0, 0, ...up]); // from a base that accelerates upward
    const F_k = Array.from(F.slice(6 * k, 6 * k + 6)), GdV = apply6(G, lifted), rest = gyroscopic(G, V), own = add(GdV, rest);
    const tau = Array.from(m.run.inverse(q, dq, ddq, wrench)), poses = m.poses(q);
    const force = (i) => turn(poses[i], Array.from(F.slice(6 * i + 3, 6 * i + 6)));
    return {
      tables: [
        { caption: "Outward: twist of the link, in its frame {i}", columns: TWIST, rows: [[sub_(V_, "i"), V]] },
        { caption: `and its rate, with gravity: ${DV_}<sub>0</sub> = (0, −<i>g</i>)`, columns: CHANGE, rows: [[sub_(DV_, "i"), lifted]] },
        { caption: "Inward: the wrench that carries the link, in {i}", columns: WRENCH, rows: [[`${G_}${DV_}`, GdV], [`−[ad]<sup>T</sup>${G_}${V_}`, rest], ["from beyond", add(F_k, times(-1, own))], [sub_(F_, "i"), F_k]] },
      ],
      values: [["along its joint: F<sub>i</sub><sup>T</sup> A<sub>i</sub>", dot6(F_k, A), A.slice(0, 3).some((x) => x) ? "N m" : "N"]],
      tau, title: "Torques τ of every joint", frames: [["{i}", T]],
      arrows: [k, ...poses.keys()].filter((i, at) => i !== k || !at).map((i) => ({ name: i === k ? "force that carries this link" : "those of the others", p: place(poses[i]), along: force(i), most: 2 * m.robot.push, colour: i === k ? 1 : 7 })),
    };
  },

  "8.5": (m, { q, dq, tau }) => {
    const n = tau.length, zero = tau.map(() => 0), on = m.wrenches(q), M = m.massMatrix(q);
    const ddq = Array.from(m.run.acceleration(q, dq, tau, ...on, ...m.load)), h = Array.from(m.run.inverse(q, dq, zero, ...on, ...m.load));
    const gap = Math.max(...joints(m).map((_, i) => Math.abs(dot6(ddq, M.slice(n * i, n * i + n)) + h[i] - tau[i])));
    return {
      tables: [
        { caption: "Joint by joint; what the push takes is in h", columns: jointColumns(m, ""), rows: [["<i>τ</i> [N m, N]", tau], ["<i>h</i> [N m, N]", h], ["<i>τ − h</i>", add(tau, times(-1, h))], ['<i class="ddot">θ</i> [1/s²]', ddq]] },
        { caption: "Mass matrix M(θ) [kg m²; sliding joints: kg]", columns: jointColumns(m, ""), rows: rowsOf(M, joints(m), n), heat: true },
      ],
      values: [['check: largest entry of <i>M</i><i class="ddot">θ</i> + <i>h</i> − <i>τ</i>', gap, "N m"]],
      tau, title: "Torques τ, as they are set", arrows: [],
    };
  },

  "8.6": (m, { q, dq, dV }) => {
    const { rows } = m.robot.book, n = rows.length, names = rows.map((row) => ["x", "y", "z"][row]), columns = m.tipColumns(q), p = place(m.tipPose(q));
    const { Lambda, pivots } = m.run.task_inertia(q, ...m.load), eta = Array.from(m.run.task_bias(q, dq, ...m.load).eta);
    const pulled = rowsOf(Lambda, names, n).map(([, row]) => dot6(dV, row)), F = add(pulled, eta);
    const tau = columns.map((column) => rows.reduce((sum, row, i) => sum + column[row] * F[i], 0));
    const ddq = m.run.acceleration(q, dq, tau, ...m.still, ...m.load), reached = m.run.tip_acceleration(q, dq, ddq);
    const along = [0, 0, 0];
    rows.forEach((row, i) => { along[row] = F[i]; });
    return {
      tables: [
        { caption: "Λ(θ), in the axes of {s} [kg]", columns: names.map((name) => [name, ""]), rows: rowsOf(Lambda, names, n), heat: true },
        { caption: "Force that the torques put on the tip", columns: names.map((name) => [name, "N"]), rows: [[`Λ ${DV_}`, pulled], ["<i>η</i>", eta], [F_, F]] },
        { caption: "Acceleration of the tip", columns: names.map((name) => [name, "m/s²"]), rows: [["wanted", dV], ["it gets", rows.map((row) => reached[3 + row])]] },
      ],
      values: [["smallest pivot of J<sub>v</sub> <i>M</i><sup>−1</sup> J<sub>v</sub><sup>T</sup>; where it is near zero, Λ is wrong", Math.min(...pivots), "1/kg"]],
      tau, title: "Torques of that force", frames: [["{s}", IDENTITY]],
      arrows: [{ name: "force F", p, along, most: m.robot.push, colour: 5 }],
    };
  },
};
