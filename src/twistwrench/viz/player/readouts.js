// What the pages of the book's sections compute, by the number of the section: tables, numbers, torques, and arrows. MR.
"use strict";

const apply6 = (G, V) => [0, 1, 2, 3, 4, 5].map((i) => inner(V, G.slice(6 * i, 6 * i + 6)));
const columnsOf = (first, second, one, two) => [...["x", "y", "z"].map((k) => [`${first}<sub>${k}</sub>`, one]), ...["x", "y", "z"].map((k) => [`${second}<sub>${k}</sub>`, two])];
const TWIST = columnsOf("ω", "v", "rad/s", "m/s"), CHANGE = columnsOf('<i class="dot low">ω</i>', '<i class="dot low">v</i>', "rad/s²", "m/s²"), WRENCH = columnsOf("m", "f", "N m", "N");
const V_ = "<i>V</i>", F_ = "<i>F</i>", G_ = "<i>G</i>", DV_ = '<i class="dot">V</i>', sub_ = (letter, index) => `${letter}<sub>${index}</sub>`;

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
      values: [["kinetic energy ½ Vᵀ G V", inner(V, P) / 2, "J"]],
      arrows: [
        { name: "velocity of its origin", p, along: turn(T, V.slice(3)), most: 1, unit: "m/s", colour: "twist" },
        { name: "total force on it", p, along: turn(T, F.slice(3)), most: 5 * G[35] || 1, unit: "N for this link", colour: "wrench" },
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
        { caption: "Inward: the wrench that carries the link, in {i}", columns: WRENCH, rows: [[`${G_}${DV_}`, GdV], [`−[ad]<sup>T</sup>${G_}${V_}`, rest], ["[Ad]<sup>T</sup><i>F</i><sub>i+1</sub>", add(F_k, times(-1, own))], [sub_(F_, "i"), F_k]] },
      ],
      values: [["along its joint: F<sub>i</sub><sup>T</sup> A<sub>i</sub>", inner(F_k, A), A.slice(0, 3).some((x) => x) ? "N m" : "N"]],
      tau, title: "Torques τ of every joint", frames: [["{i}", T]],
      arrows: [k, ...poses.keys()].filter((i, at) => i !== k || !at).map((i) => ({ name: i === k ? "force that carries this link" : "those of the others", p: place(poses[i]), along: force(i), most: 2 * m.robot.push, unit: "N", colour: i === k ? "wrench" : "change" })),
    };
  },

  "8.4": (m, state) => {
    const { q, dq, chosen: k } = state, n = dq.length, { links, gravity } = m.robot.book, poses = m.poses(q);
    const rows = links.map((_, i) => rowsOf(m.run[`J${i}`](q), TWIST, n).map(([, row]) => row)); // of L A, six for each link
    const share = (i) => { // J' G J, and J' G (0, -g)
      const J = rows[i], G = links[i].inertia, column = (j) => J.map((row) => row[j]), up = [0, 0, 0, ...turnedBack(poses[i], times(-1, gravity))];
      const GJ = joints(m).map((_, j) => apply6(G, column(j)));
      return { M: joints(m).map((_, j) => GJ.map((P) => inner(column(j), P))), g: joints(m).map((_, j) => inner(column(j), apply6(G, up))) };
    };
    const shares = links.map((_, i) => share(i)), M = joints(m).map((_, i) => shares.map((s) => s.M[i]).reduce(add)), g = shares.map((s) => s.g).reduce(add);
    return {
      tables: [
        { caption: "Rows of L A for this link: its body Jacobian [rad, m per rad or m]", columns: jointColumns(m, ""), rows: TWIST.map(([name], i) => [name, rows[k][i]]), heat: true },
        { caption: "and its twist, these rows times θ̇", columns: TWIST, rows: [[sub_(V_, "i"), rows[k].map((row) => inner(row, dq))]] },
        { caption: "What this link adds to M [kg m²; sliding joints: kg]", columns: jointColumns(m, ""), rows: joints(m).map((name, i) => [name, shares[k].M[i]]), heat: true },
        { caption: "M, the sum over all links", columns: jointColumns(m, ""), rows: joints(m).map((name, i) => [name, M[i]]), heat: true },
        { caption: "Torques of gravity [N m; sliding joints: N]", columns: jointColumns(m, ""), rows: [["this link", shares[k].g], ["<i>g</i>, all links", g]] },
      ],
      tau: g, title: "Torques g, the sum over all links", frames: [["{i}", poses[k]]], arrows: [],
    };
  },

  "8.5": (m, { q, dq, tau }) => {
    const n = tau.length, zero = tau.map(() => 0), on = m.wrenches(q), M = m.massMatrix(q);
    const ddq = Array.from(m.run.acceleration(q, dq, tau, ...on, ...m.load)), h = Array.from(m.run.inverse(q, dq, zero, ...on, ...m.load));
    const gap = Math.max(...joints(m).map((_, i) => Math.abs(inner(ddq, M.slice(n * i, n * i + n)) + h[i] - tau[i])));
    return {
      tables: [
        { caption: "Joint by joint (sliding joints: N, m/s²); h counts the push, too", columns: jointColumns(m, ""), rows: [["<i>τ</i> [N m]", tau], ["<i>h</i> [N m]", h], ["<i>τ − h</i>", add(tau, times(-1, h))], ['<i class="ddot">θ</i> [rad/s²]', ddq]] },
        { caption: "Mass matrix M(θ) [kg m²; sliding joints: kg]", columns: jointColumns(m, ""), rows: rowsOf(M, joints(m), n), heat: true },
      ],
      values: [['check: largest entry of <i>M</i><i class="ddot">θ</i> + <i>h</i> − <i>τ</i>', gap, "N m"]],
      tau, title: "Torques τ, as they are set", arrows: [],
    };
  },

  "8.6": (m, { q, dq, dV }) => {
    const { rows } = m.robot.book, n = rows.length, names = rows.map((row) => ["x", "y", "z"][row]), columns = m.tipColumns(q), p = place(m.tipPose(q));
    const { Lambda, pivots } = m.run.task_inertia(q, ...m.load), eta = Array.from(m.run.task_bias(q, dq, ...m.load).eta);
    const pulled = rowsOf(Lambda, names, n).map(([, row]) => inner(dV, row)), F = add(pulled, eta);
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
      arrows: [{ name: "force F", p, along, most: m.robot.push / 2, unit: "N", colour: "wrench" }],
    };
  },

  "8.7": (m, { q, dq, tau }) => {
    const n = tau.length, on = m.wrenches(q), M = m.massMatrix(q), A = Array.from(m.run.wall(q)), axis = m.robot.book.rows[0], p = place(m.tipPose(q));
    const L = cholesky(M, n), MiA = raised(L, lowered(L, A)), S = inner(A, MiA), free = add(dq, times(-inner(A, dq) / S, MiA)); // M^-1 A', A M^-1 A', P' dq
    const P = A.map((a, i) => MiA.map((b, j) => Number(i === j) - (a * b) / S));
    const { ddq, lambda } = m.run.constrained(q, free, tau, ...on, ...m.load), h = Array.from(m.run.inverse(q, free, tau.map(() => 0), ...on, ...m.load));
    const rest = add(tau, times(-1, h)), held = times(lambda[0], A), back = Array.from(m.run.wall_bias(q, free))[0];
    const gap = Math.max(...rowsOf(M, joints(m), n).map(([, row], i) => Math.abs(inner(ddq, row) + held[i] - rest[i])));
    const normal = [0, 1, 2].map((k) => Number(k === axis)), across = [normal.slice(1).concat(normal[0]), normal.slice(2).concat(normal.slice(0, 2))], wide = 0.26 * m.robot.size;
    return {
      tables: [
        { caption: "Joint by joint (sliding joints: N, m/s²)", columns: jointColumns(m, ""), rows: [["<i>A</i>", A], ['<i class="dot">θ</i>, allowed', free], ["<i>τ − h</i> [N m]", rest], ["<i>P</i> (<i>τ − h</i>)", P.map((row) => inner(rest, row))], ["<i>A</i><sup>T</sup>λ", held], ['<i class="ddot">θ</i> [rad/s²]', Array.from(ddq)]] },
        { caption: "Projector P: of torques, the part that moves the robot along the wall", columns: jointColumns(m, ""), rows: joints(m).map((name, i) => [name, P[i]]), heat: true },
      ],
      values: [
        ["λ, the force of the tip on the wall", lambda[0], "N"],
        [`place of the tip along ${"xyz"[axis]}`, p[axis], "m"],
        ['check: <i>A</i><i class="ddot">θ</i> + <i class="dot">A</i><i class="dot">θ</i>', inner(A, ddq) + back, "m/s²"],
        ['check: largest entry of <i>M</i><i class="ddot">θ</i> + <i>h</i> + <i>A</i><sup>T</sup>λ − <i>τ</i>', gap, "N m"],
      ],
      dq: free, tau, title: "Torques τ, as they are set",
      solids: [{ name: "wall", p, shape: ellipsoidOf([wide, wide, 0.004 * wide], [...across, normal]), colour: 4 }],
      arrows: [{ name: "force λ on the wall", p, along: times(lambda[0], normal), most: m.robot.push / 4, unit: "N", colour: "wrench" }],
    };
  },

  "8.9": (m, { q, dq, ddq, motor }) => {
    const [ratio, cm2, viscous, coulomb] = motor, n = dq.length, M = m.massMatrix(q), reflected = ratio ** 2 * 1e-4 * cm2; // G^2 I, from kg cm^2
    const links = Array.from(m.run.inverse(q, dq, ddq, ...m.load)), rotors = times(reflected, ddq);
    const friction = Array.from(m.run.friction(dq, joints(m).flatMap(() => [viscous, coulomb]))), tau = add(add(links, rotors), friction);
    const torque = times(1 / ratio, tau), speed = times(ratio, dq);
    return {
      tables: [
        { caption: "At each joint: inertia of links and rotor, and what the torque is made of", columns: [["links, <i>m</i><sub>ii</sub>", "kg m²"], ["<i>G</i>²<i>I</i><sub>rotor</sub>", "kg m²"], ["τ<sub>links</sub>", "N m"], ['<i>G</i>²<i>I</i><i class="ddot">θ</i>', "N m"], ["friction", "N m"], ["<i>τ</i>", "N m"]], rows: joints(m).map((k, i) => [k, [M[n * i + i], reflected, links[i], rotors[i], friction[i], tau[i]]]) },
        { caption: "At its motor, before the gear", columns: [["torque", "N m"], ["speed", "rad/s"], ["power", "W"]], rows: joints(m).map((k, i) => [k, [torque[i], speed[i], torque[i] * speed[i]]]) },
      ],
      tau, title: "Torques of the drives, at the joints", arrows: [],
    };
  },
};
