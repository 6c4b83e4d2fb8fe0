// Drawing with WebGL 2: surfaces lit and shaded, their shadow on the floor, and lines.
"use strict";

const SHADED = [`#version 300 es
in vec3 position; in vec3 normal;
uniform mat4 camera, model; uniform mat3 turned;
out vec3 n, at;
void main() { vec4 p = model * vec4(position, 1.0); at = p.xyz; n = turned * normal; gl_Position = camera * p; }`,
`#version 300 es
precision highp float;
in vec3 n, at; uniform vec4 colour; uniform vec3 eye; out vec4 result;
void main() {
  vec3 view = normalize(eye - at), N = normalize(n);
  if (dot(N, view) < 0.0) N = -N;
  vec3 sun = normalize(vec3(0.35, -0.45, 0.85)), half_ = normalize(sun + view);
  float light = 0.52 + 0.16 * N.z + 0.42 * max(dot(N, sun), 0.0) + 0.10 * max(dot(N, view), 0.0);
  if (colour.a < 1.0) light = mix(light, 1.0, 0.7); // what can be seen through shows its own colour
  float gloss = 0.16 * pow(max(dot(N, half_), 0.0), 36.0);
  float rim = colour.a < 1.0 ? 0.45 * pow(1.0 - max(dot(N, view), 0.0), 2.0) : 0.0;
  float a = colour.a + rim * (1.0 - colour.a);
  result = vec4(min(colour.rgb * light + gloss, 1.0) * a, a);
}`];
const PLAIN = [`#version 300 es
in vec3 position; uniform mat4 camera, model; out vec3 at;
void main() { vec4 p = model * vec4(position, 1.0); at = p.xyz; gl_Position = camera * p; }`,
`#version 300 es
precision highp float;
in vec3 at; uniform vec4 colour; uniform vec3 middle; uniform float reach; out vec4 result;
void main() {
  float fade = reach > 0.0 ? 1.0 - smoothstep(0.25 * reach, reach, distance(at.xy, middle.xy)) : 1.0;
  result = vec4(colour.rgb, 1.0) * colour.a * fade;
}`];

class Stage extends Orbit {
  constructor(canvas, size, gl) {
    super(canvas, size);
    this.gl = gl;
    this.shaded = this.program(SHADED);
    this.plain = this.program(PLAIN);
  }

  // Where several samples of each pixel are drawn; their mean goes to the canvas.
  sampled(width, height, count) {
    const gl = this.gl, now = `${width} ${height} ${count}`;
    if (this.fine?.made !== now) {
      if (this.fine) { gl.deleteFramebuffer(this.fine.place); this.fine.stores.forEach((store) => gl.deleteRenderbuffer(store)); }
      this.fine = { made: now, place: gl.createFramebuffer(), stores: [gl.createRenderbuffer(), gl.createRenderbuffer()] };
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.fine.place);
      [[gl.RGBA8, gl.COLOR_ATTACHMENT0], [gl.DEPTH24_STENCIL8, gl.DEPTH_STENCIL_ATTACHMENT]].forEach(([kind, part], k) => {
        gl.bindRenderbuffer(gl.RENDERBUFFER, this.fine.stores[k]);
        gl.renderbufferStorageMultisample(gl.RENDERBUFFER, Math.min(count, gl.getParameter(gl.MAX_SAMPLES)), kind, width, height);
        gl.framebufferRenderbuffer(gl.FRAMEBUFFER, part, gl.RENDERBUFFER, this.fine.stores[k]);
      });
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.fine.place);
  }

  program([vertex, fragment]) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "position");
    gl.bindAttribLocation(program, 1, "normal");
    gl.linkProgram(program);
    const at = {};
    for (const name of ["camera", "model", "turned", "colour", "eye", "middle", "reach"]) at[name] = gl.getUniformLocation(program, name);
    return { program, at };
  }

  // A surface, or a line where it has no faces, kept in the graphics memory.
  keep({ positions, normals, faces }) {
    const gl = this.gl, array = gl.createVertexArray(), buffers = [];
    const fill = (kind, data) => {
      buffers.push(gl.createBuffer());
      gl.bindBuffer(kind, buffers[buffers.length - 1]);
      gl.bufferData(kind, data, gl.STATIC_DRAW);
    };
    gl.bindVertexArray(array);
    [positions, normals].forEach((data, k) => {
      if (!data) return;
      fill(gl.ARRAY_BUFFER, data);
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 0, 0);
    });
    if (faces) fill(gl.ELEMENT_ARRAY_BUFFER, faces);
    gl.bindVertexArray(null);
    return { array, buffers, count: faces ? faces.length : positions.length / 3 };
  }

  forget(kept) {
    kept.buffers.forEach((buffer) => this.gl.deleteBuffer(buffer));
    this.gl.deleteVertexArray(kept.array);
  }

  // items: {kept, model, colour [r, g, b, a], shadow, closed, over}; lines: {kept, colour, reach, strip}; fineness as Sharpness has it.
  draw(items, lines, floor, _, { most, samples, shadows, exact }) {
    const gl = this.gl, canvas = this.canvas, ratio = exact || Math.min(window.devicePixelRatio || 1, most);
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    if (samples) this.sampled(width, height, samples);
    else gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA); // colours come multiplied by their opacity, as the page takes them
    const { camera, eye } = this.camera();
    const use = ({ program, at }) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(at.camera, true, camera);
      gl.uniform3fv(at.eye, eye);
      return at;
    };
    const solid = (at, { kept, model, colour }) => {
      gl.uniformMatrix4fv(at.model, true, model);
      if (at.turned) gl.uniformMatrix3fv(at.turned, true, normalMatrix(model));
      gl.uniform4fv(at.colour, colour);
      gl.bindVertexArray(kept.array);
      gl.drawElements(gl.TRIANGLES, kept.count, gl.UNSIGNED_INT, 0);
    };
    let at = use(this.shaded);
    items.filter((item) => item.colour[3] === 1 && !item.over).forEach((item) => solid(at, item));
    at = use(this.plain);
    if (shadows) this.shadow(at, items, floor, solid);
    gl.uniformMatrix4fv(at.model, true, IDENTITY);
    for (const { kept, colour, reach, strip } of lines) {
      gl.uniform4fv(at.colour, colour);
      gl.uniform1f(at.reach, reach || 0);
      gl.uniform3fv(at.middle, this.target);
      gl.bindVertexArray(kept.array);
      gl.drawArrays(strip ? gl.LINE_STRIP : gl.LINES, 0, kept.count);
    }
    at = use(this.shaded);
    gl.depthMask(false);
    for (const item of items.filter(({ colour }) => colour[3] < 1)) {
      if (item.closed) gl.enable(gl.CULL_FACE); // the near side alone
      solid(at, item);
      gl.disable(gl.CULL_FACE);
    }
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    items.filter((item) => item.over).forEach((item) => solid(at, item));
    gl.disable(gl.CULL_FACE);
    gl.depthMask(true);
    gl.bindVertexArray(null);
    if (!samples) return;
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
  }

  // Everything that casts one, flattened along the light onto the floor; the stencil keeps it from darkening twice.
  shadow(at, items, floor, solid) {
    const gl = this.gl, flat = [1, 0, -0.41, 0.41 * floor, 0, 1, 0.53, -0.53 * floor, 0, 0, 0, floor, 0, 0, 0, 1];
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.depthMask(false);
    gl.uniform1f(at.reach, 0);
    for (const item of items)
      if (item.shadow) solid(at, { kept: item.kept, model: mul(flat, item.model), colour: [0.12, 0.16, 0.24, 0.13] });
    gl.depthMask(true);
    gl.disable(gl.STENCIL_TEST);
  }
}

function normalMatrix(T) { // the cofactors of the upper left part: right for scaled and skewed ones too, up to length
  const r = [0, 1, 2].map((i) => T.slice(4 * i, 4 * i + 3));
  return [...cross(r[1], r[2]), ...cross(r[2], r[0]), ...cross(r[0], r[1])];
}
