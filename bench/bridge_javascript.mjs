// Under Node: the contenders of bench/bridge_javascript.py. One line of JSON in, one out.
import { createRequire } from "node:module";
import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";

const QUANTITIES = ["inverse_dynamics", "mass_matrix", "forward_dynamics", "jacobian"];
let contenders = {};

const make = { twistwrench: ours, MuJoCo: mujoco, Pinocchio: pinocchio };

/** Everything that computes: by name and quantity, a function of one state (q, dq, x) that gives an array, rows first. */
async function load(sent) {
  for (const name of ["twistwrench", ...sent.peers]) contenders[name] = await make[name](sent);
  const rows = sent.states.map((x) => x.map((row) => Float64Array.from(row)));
  contenders.states = rows[0].map((q, k) => [q, rows[1][k], rows[2][k]]);
  return process.version.slice(1);
}

async function ours({ files }) {
  const found = {};
  for (const quantity of QUANTITIES) {
    const compute = (await import(files[quantity]))[quantity];
    const out = new Float64Array(quantity === "mass_matrix" ? 49 : quantity === "jacobian" ? 42 : 7);
    const one = quantity === "mass_matrix" || quantity === "jacobian";
    found[quantity] = one ? (q) => compute(q, out) : (q, dq, x) => compute(q, dq, x, out);
  }
  return found;
}

/** The shortest calls that set a state and leave the result in an array; friction, contacts and limits off. */
async function mujoco({ modules, mjcf, frame }) {
  const require = createRequire(modules);
  const mj = await (await import(pathToFileURL(require.resolve("@mujoco/mujoco")).href)).default();
  const model = mj.MjModel.from_xml_string(mjcf), data = new mj.MjData(model);
  for (const name of ["CONSTRAINT", "CONTACT", "DAMPER", "EQUALITY", "FRICTIONLOSS", "LIMIT", "SENSOR", "SPRING", "WARMSTART"])
    model.opt.disableflags |= mj.mjtDisableBit[`mjDSBL_${name}`].value;
  const [tau, M, v, w] = [7, 49, 21, 21].map((size) => new mj.DoubleBuffer(size));
  const [tauView, MView, vView, wView] = [tau, M, v, w].map((buffer) => buffer.GetView());
  const { qpos, qvel, qacc, qfrc_applied: applied } = data, link = model.body(frame).id, J = new Float64Array(42);
  return {
    inverse_dynamics(q, dq, ddq) {
      qpos.set(q), qvel.set(dq), qacc.set(ddq);
      mj.mj_kinematics(model, data), mj.mj_comPos(model, data), mj.mj_comVel(model, data);
      mj.mj_rne(model, data, 1, tau);
      return tauView;
    },
    mass_matrix(q) {
      qpos.set(q);
      mj.mj_kinematics(model, data), mj.mj_comPos(model, data), mj.mj_makeM(model, data), mj.mj_fullM(model, data, M);
      return MView;
    },
    forward_dynamics(q, dq, force) {
      qpos.set(q), qvel.set(dq), applied.set(force);
      mj.mj_forward(model, data);
      return qacc;
    },
    jacobian(q) {
      qpos.set(q);
      mj.mj_kinematics(model, data), mj.mj_comPos(model, data), mj.mj_jac(model, data, v, w, [0, 0, 0], link);
      J.set(wView), J.set(vView, 21); // angular rows first
      return J;
    },
  };
}

async function pinocchio({ modules, urdf }) {
  const require = createRequire(modules), here = createRequire(require.resolve("pinocchio-js"));
  globalThis.DOMParser = here("xmldom").DOMParser;
  const pin = await quietly(() => require("pinocchio-js")());
  const file = require.resolve("pinocchio-js/src/urdf-parser.mjs");
  const { buildPinocchioModel, parseURDF } = await import(pathToFileURL(file).href);
  const model = buildPinocchioModel(pin, parseURDF(urdf)), data = new pin.Data(model), J = new Float64Array(42);
  return {
    inverse_dynamics: (q, dq, ddq) => pin.rnea(model, data, q, dq, ddq),
    mass_matrix: (q) => pin.crba(model, data, q), // symmetric: rows are columns
    forward_dynamics: (q, dq, tau) => pin.aba(model, data, q, dq, tau),
    jacobian(q) {
      pin.computeJointJacobians(model, data, q);
      const theirs = pin.getJointJacobian(model, data, 7, pin.ReferenceFrame.WORLD); // column by column, linear part first
      for (let k = 0; k < 7; k++) for (let i = 0; i < 6; i++) J[7 * ((i + 3) % 6) + k] = theirs[6 * k + i];
      return J;
    },
  };
}

/** Whatever a package prints while it loads is no answer of ours. */
async function quietly(work) {
  const { log } = console;
  console.log = () => {};
  try {
    return await work();
  } finally {
    console.log = log;
  }
}

function answer(question) {
  if (question.values) {
    const [name, quantity, count] = question.values, compute = contenders[name][quantity];
    return contenders.states.slice(0, count).map((state) => Array.from(compute(...state)));
  }
  const [name, quantity, count] = question.sweep, compute = contenders[name][quantity], { states } = contenders;
  let seen = 0;
  for (let n = 0; n < count; n++) for (const [q, dq, x] of states) seen += compute(q, dq, x)[0];
  return Number.isFinite(seen);
}

for await (const line of createInterface({ input: process.stdin })) {
  const question = JSON.parse(line);
  console.log(JSON.stringify(question.states ? await load(question) : answer(question)));
}
