// What the pages of sections 3.4 and 5.1 to 5.4 compute: the tip's twists, wrenches and Jacobians. MR chapters 3 and 5.
"use strict";

function wrenchMoved(T, F) { // [Ad of T^-1]' F: F given in {b}, in {s}, with T = T_sb. MR (3.98)
  const m = turn(T, F.slice(0, 3)), f = turn(T, F.slice(3)), p = place(T);
  return [...add(m, cross(p, f)), ...f];
}

Object.assign(READOUTS, {
  "3.4": (m, { q, dq, wrench }) => {
    const T = m.tipPose(q), V_b = Array.from(m.run.twist_b(q, dq)), V_s = Array.from(m.run.twist_s(q, dq)), F_s = wrenchMoved(T, wrench);
    return {
      tables: [
        { caption: "Twist of the tip", columns: TWIST, rows: [[sub_(V_, "b"), V_b], [sub_(V_, "s"), V_s]] },
        { caption: "Wrench that the tip applies", columns: WRENCH, rows: [[sub_(F_, "b"), wrench], [sub_(F_, "s"), F_s]] },
      ],
      values: [["power, by the numbers in {b}", inner(V_b, wrench), "W"], ["power, by the numbers in {s}", inner(V_s, F_s), "W"]],
      frames: [["{s}", IDENTITY], ["{b}", T]],
      arrows: [
        { name: "velocity v", p: place(T), along: turn(T, V_b.slice(3)), most: 1.5, unit: "m/s", colour: "twist" },
        { name: "angular velocity ω", p: place(T), along: turn(T, V_b.slice(0, 3)), most: 4, unit: "rad/s", colour: 1 },
        { name: "force f", p: place(T), along: turn(T, wrench.slice(3)), most: most(m, 3), unit: "N", colour: "wrench" },
        { name: "moment m", p: place(T), along: turn(T, wrench.slice(0, 3)), most: most(m, 0), unit: "N m", colour: "momentum" },
      ],
    };
  },

  "5.1": (m, { q, dq }) => {
    const n = dq.length, names = TWIST.map(([name]) => name), columns = m.tipColumns(q), p = place(m.tipPose(q));
    return {
      tables: [
        { caption: "Body Jacobian J<sub>b</sub>, a column for each joint [rad, m per rad or m]", columns: jointColumns(m, ""), rows: rowsOf(m.run.jacobian_b(q), names, n), heat: true },
        { caption: "Space Jacobian J<sub>s</sub>", columns: jointColumns(m, ""), rows: rowsOf(m.run.jacobian_s(q), names, n), heat: true },
        { caption: "Twist of the tip, in {b}", columns: TWIST, rows: [[sub_(V_, "b"), Array.from(m.run.twist_b(q, dq))]] },
      ],
      arrows: columns.map((along, k) => ({ name: `v of column ${k + 1}`, p, along, most: 0.5 * m.robot.size, unit: "m/s", colour: k })),
    };
  },

  "5.2": (m, { q, wrench }) => {
    const n = m.robot.torques.length, J = m.run.jacobian_b(q), tau = Array.from(m.run.statics(q, wrench)), T = m.tipPose(q);
    const products = joints(m).map((name, k) => [name, [...wrench.map((F, i) => J[n * i + k] * F), tau[k]]]);
    return {
      tables: [{ caption: "Products of column i of J<sub>b</sub> with F<sub>b</sub>, and their sum [N m; sliding joints: N]", columns: [...WRENCH.map(([name]) => [name, ""]), ["<i>τ</i><sub>i</sub>", ""]], rows: products, heat: true }],
      tau, title: "Torques of the wrench", frames: [["{b}", T]],
      arrows: [
        { name: "force f", p: place(T), along: turn(T, wrench.slice(3)), most: most(m, 3), unit: "N", colour: "wrench" },
        { name: "moment m", p: place(T), along: turn(T, wrench.slice(0, 3)), most: most(m, 0), unit: "N m", colour: "momentum" },
      ],
    };
  },

  "5.3": (m, { q }) => {
    const n = m.robot.torques.length, { ranks } = m.robot.book, J = m.run.jacobian_b(q), size = m.robot.size, T = m.tipPose(q), p = place(T);
    const found = singular(TWIST.map((_, i) => Array.from(J.slice(n * i, n * (i + 1)), (x) => (i < 3 ? x : x / size)))).slice(0, ranks.all), last = found[found.length - 1];
    const lost = last.left.map((x, i) => (i < 3 ? x : x * size));
    return {
      tables: [
        { caption: `Singular values of J<sub>b</sub>, lengths in units of ${size.toPrecision(3)} m`, columns: found.map((_, k) => [`<i>σ</i><sub>${k + 1}</sub>`, ""]), rows: [["", found.map(({ value }) => value)]] },
        { caption: "The twist of the tip that is hardest to reach, in {b}; lost where the last σ is zero", columns: TWIST, rows: [[V_, lost]] },
        { caption: "Joint velocities of norm 1 that move the tip least in this way", columns: jointColumns(m, ""), rows: [['<i class="dot">θ</i>', last.right]] },
      ],
      values: [["rank of J<sub>b</sub>, at most " + ranks.all, found.filter(({ value }) => value > 1e-6 * found[0].value).length, ""], ["norm of θ̇ for that twist", last.value > 1e-9 * found[0].value ? 1 / last.value : Infinity, ""]],
      frames: [["{b}", T]],
      arrows: [
        { name: "v of the twist that is hardest", p, along: turn(T, lost.slice(3)), most: size, unit: "m/s", colour: "twist" },
        { name: "its ω", p, along: turn(T, lost.slice(0, 3)), most: 1, unit: "rad/s", colour: 1 },
      ],
    };
  },

  "5.4": (m, { q }) => {
    const n = m.robot.torques.length, { ranks } = m.robot.book, { size } = m.robot, p = place(m.tipPose(q));
    const of = (at, first, count) => { const J = m.jacobian(at); return singular([0, 1, 2].map((i) => J.slice(n * (first + i), n * (first + i + 1)))).map((s, k) => ({ ...s, there: k < count })); };
    const linear = of(q, 3, ranks.linear), angular = of(q, 0, ranks.angular), known = (ranks.linear ? linear : angular).filter(({ there }) => there), start = of(m.robot.start, 3, ranks.linear);
    const rows = (found) => found.filter(({ there }) => there).map(({ value, left }, k) => [k + 1, [value, 1 / value, ...left]]);
    const table = (name, units, found) => ({ caption: `${name}: semi-axes of both ellipsoids, and their direction in the axes of {s}`, columns: [["velocity", units[0]], [units[2], units[1]], ["x", ""], ["y", ""], ["z", ""]], rows: rows(found) });
    const drawn = (name, amount, typical, length, unit_, colour) => { // with axes of those lengths, cut off where they grow beyond bounds
      const per = perSquare(typical, length, size), lengths = linear.map((s) => (s.there ? (amount(s.value) / per) * squareOf(size) : 0.004 * size));
      return { name, p, scale: [per, unit_], cut: Math.max(...lengths) > 0.3 * size, shape: ellipsoidOf(lengths.map((x) => Math.min(0.3 * size, x)), linear.map(({ left }) => left)), colour };
    };
    const [long, short] = [known[0].value, known[known.length - 1].value], middle = start[Math.min(1, Math.max(0, ranks.linear - 1))].value;
    return {
      tables: [...(ranks.linear ? [table("Velocity of the tip, J<sub>v</sub>", ["m/s", "N", "force"], linear)] : []), ...(ranks.angular ? [table("Turning of the tip, J<sub>ω</sub>", ["rad/s", "N m", "moment"], angular)] : [])],
      values: [["μ<sub>1</sub>, longest by shortest semi-axis of the first table", long / short, ""], ["μ<sub>2</sub> = μ<sub>1</sub>²", (long / short) ** 2, ""], ["μ<sub>3</sub>, product of the semi-axes, as the volume", known.reduce((x, { value }) => x * value, 1), ""]],
      solids: !ranks.linear ? [] : [drawn("velocities, |θ̇| = 1", (value) => value, start[0].value, 0.2 * size, "m/s", "twist"), drawn("forces, |τ| = 1", (value) => 1 / value, 1 / middle, 0.05 * size, "N", "wrench")],
      arrows: [],
    };
  },
});
