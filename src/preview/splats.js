'use strict';
// splats.js - draws the records of a .splat with WebGL2, as the renderer of the fit does (src/render/README.md, M.1):
// each Gaussian a quad around its ellipse on the screen, blended from the farthest to the nearest.

const SPLAT_BYTES = 32, ROW_SPLATS = 1024; // two texels of 16 bytes a Gaussian
const SH_ROW = 2048; // as many texels of the SH a Gaussian as its degree; they go on over the rows' ends
const shBytes = degree => 16 * degree;

const VERTEX = `#version 300 es
precision highp float;
precision highp usampler2D;
uniform usampler2D records, harmonics;
uniform int degree;        // of the spherical harmonics; 0: constant colours
uniform mat3 R;            // world to camera
uniform vec3 t;
uniform vec2 focal, middle, size; // px
uniform vec2 limit;        // of x/z, y/z where the Jacobian is taken
uniform float near;
uniform bool antialiased;
in uint index;
out vec2 offset;           // px, from the mean
flat out vec3 factors;     // l00, l01, 1 / sqrt(c)
flat out vec4 color;

const float LOW_PASS = 0.3;

mat3 rotation(vec4 q) { // w x y z; columns
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(1. - 2. * (y * y + z * z), 2. * (x * y + z * w), 2. * (x * z - y * w),
              2. * (x * y - z * w), 1. - 2. * (x * x + z * z), 2. * (y * z + x * w),
              2. * (x * z + y * w), 2. * (y * z - x * w), 1. - 2. * (x * x + y * y));
}

vec4 bytes(uint u) { return vec4(u & 255u, u >> 8 & 255u, u >> 16 & 255u, u >> 24); }

// What the direction adds to the colour, M.4. A value is a byte, 128 + 128 of it: [3] that the record cannot hold, then [K-1][3].
vec3 shade(vec3 d) {
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z, value[48];
  float Y[16] = float[](1., -0.4886025119 * y, 0.4886025119 * z, -0.4886025119 * x,
    1.0925484306 * x * y, -1.0925484306 * y * z, 0.3153915653 * (2. * zz - xx - yy), -1.0925484306 * x * z, 0.5462742152 * (xx - yy),
    -0.5900435899 * y * (3. * xx - yy), 2.8906114426 * x * y * z, -0.4570457995 * y * (4. * zz - xx - yy),
    0.3731763326 * z * (2. * zz - 3. * xx - 3. * yy), -0.4570457995 * x * (4. * zz - xx - yy), 1.4453057213 * z * (xx - yy),
    -0.5900435899 * x * (xx - 3. * yy));
  for (int k = 0; k < 3; k++) {
    int at = int(index) * degree + k;
    uvec4 texel = k < degree ? texelFetch(harmonics, ivec2(at % ${SH_ROW}, at / ${SH_ROW}), 0) : uvec4(0x80808080u);
    for (int i = 0; i < 4; i++) {
      vec4 four = (bytes(texel[i]) - 128.) / 128.;
      for (int j = 0; j < 4; j++) value[16 * k + 4 * i + j] = four[j];
    }
  }
  vec3 sum = vec3(0.);
  for (int k = 0; k < 16; k++) sum += Y[k] * vec3(value[3 * k], value[3 * k + 1], value[3 * k + 2]);
  return sum;
}

void main() {
  gl_Position = vec4(0., 0., 2., 1.); // outside
  ivec2 at = ivec2(int(index % ${ROW_SPLATS}u) * 2, int(index / ${ROW_SPLATS}u));
  uvec4 first = texelFetch(records, at, 0), second = texelFetch(records, at + ivec2(1, 0), 0);
  vec3 mean = uintBitsToFloat(first.xyz), scale = uintBitsToFloat(uvec3(first.w, second.xy));
  vec4 quat = (bytes(second.w) - 128.) / 128.;
  color = bytes(second.z) / 255.;
  vec3 p = R * mean + t;
  if (p.z <= near || dot(quat, quat) < 1e-6) return;

  // 1. the covariance on the screen, as a sum of squares
  vec2 slope = clamp(p.xy / p.z, -limit, limit);
  mat3 M = R * rotation(normalize(quat)) * mat3(scale.x, 0., 0., 0., scale.y, 0., 0., 0., scale.z);
  vec3 m0 = vec3(M[0].x, M[1].x, M[2].x), m1 = vec3(M[0].y, M[1].y, M[2].y), m2 = vec3(M[0].z, M[1].z, M[2].z);
  vec3 A0 = focal.x / p.z * (m0 - slope.x * m2), A1 = focal.y / p.z * (m1 - slope.y * m2);
  vec3 n = cross(A0, A1);
  float nn = dot(n, n), aa = dot(A0, A0), cc = dot(A1, A1);
  float a = aa + LOW_PASS, b = dot(A0, A1), c = cc + LOW_PASS;
  float det = nn + LOW_PASS * (aa + cc) + LOW_PASS * LOW_PASS;
  if (antialiased) color.a *= sqrt(max(2.5e-5, nn / det));

  // 2. how far it is seen: where its opacity is 1/255
  if (color.a < 1. / 255.) return;
  float r2 = 2. * log(255. * color.a), middle_of = 0.5 * (a + c), half_of = length(vec2(0.5 * (a - c), b));
  float big = middle_of + half_of, small = det / big;
  vec2 axis = half_of < 1e-6 * big ? vec2(1., 0.) : a > c ? normalize(vec2(big - c, b)) : normalize(vec2(b, big - a));
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2. - 1.;
  offset = corner.x * sqrt(r2 * big) * axis + corner.y * sqrt(r2 * small) * vec2(-axis.y, axis.x);
  factors = vec3(sqrt(c / det), -b / sqrt(c * det), inversesqrt(c));

  // 3. the colour from there
  if (degree > 0) color.rgb = max(vec3(0.), color.rgb + shade(normalize(mean + t * R)));

  // 4. pixels, y down, to the clip space
  vec2 u = focal * p.xy / p.z + middle + offset;
  gl_Position = vec4(2. * u.x / size.x - 1., 1. - 2. * u.y / size.y, 0., 1.);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec2 offset;
flat in vec3 factors;
flat in vec4 color;
out vec4 drawn;
void main() {
  vec2 e = vec2(factors.x * offset.x + factors.y * offset.y, factors.z * offset.y);
  float alpha = min(0.99, color.a * exp(-0.5 * dot(e, e)));
  if (alpha < 1. / 255.) discard;
  drawn = vec4(color.rgb * alpha, alpha);
}`;

// In a worker of its own: the order from the farthest to the nearest of those beyond the near plane. Distances are sorted
// by the bits of their floats, which rise with them, 16 at a time; what is equally far stays in order.
function sorter() {
  let means = new Float32Array(0), keys, from, to;
  const counts = new Uint32Array(65536);
  const pass = (n, shift, a, b) => {
    counts.fill(0);
    for (let i = 0; i < n; i++) counts[keys[a[i]] >>> shift & 65535]++;
    for (let i = 0, at = 0; i < 65536; i++) [counts[i], at] = [at, at + counts[i]];
    for (let i = 0; i < n; i++) b[counts[keys[a[i]] >>> shift & 65535]++] = a[i];
  };
  self.onmessage = ({ data }) => {
    if (data.means) {
      means = data.means;
      keys = new Uint32Array(means.length / 3);
      from = new Uint32Array(keys.length);
      to = new Uint32Array(keys.length);
      return;
    }
    const [x, y, z, t, near] = data.row, depths = new Float32Array(keys.buffer);
    let n = 0;
    for (let i = 0; i < keys.length; i++) {
      const depth = x * means[3 * i] + y * means[3 * i + 1] + z * means[3 * i + 2] + t;
      if (!(depth > near)) continue;
      depths[i] = depth;
      keys[i] = ~keys[i];
      from[n++] = i;
    }
    pass(n, 0, from, to);
    pass(n, 16, to, from);
    const order = from.slice(0, n);
    self.postMessage({ order, serial: data.serial, model: data.model }, [order.buffer]);
  };
}

class SplatView {
  // `changed` is called when something new can be drawn.
  constructor(canvas, changed) {
    this.gl = canvas.getContext('webgl2', { alpha: false, antialias: false, powerPreference: 'high-performance' });
    Object.assign(this, { canvas, changed, count: 0, drawn: 0, model: 0, serial: 0, sorted: 0, row: '' });
    canvas.addEventListener('webglcontextlost', e => { e.preventDefault(); this.drawn = 0; });
    canvas.addEventListener('webglcontextrestored', () => { this.setUp(); this.texels = null; if (this.bytes) this.set(this.bytes, this.antialiased, this.sh, this.degree); });
    if (!this.gl) return;
    this.setUp();
    const source = URL.createObjectURL(new Blob([`(${sorter})()`], { type: 'text/javascript' }));
    this.worker = new Worker(source);
    this.worker.onmessage = ({ data }) => this.take(data);
  }

  setUp() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    this.at = Object.fromEntries(['R', 't', 'focal', 'middle', 'size', 'limit', 'near', 'antialiased', 'degree', 'records', 'harmonics'].map(
      name => [name, gl.getUniformLocation(program, name)]));
    this.unit('records', 0);
    this.unit('harmonics', 1);
    this.upload(1, SH_ROW, 1, new Uint32Array(4 * SH_ROW)); // a sampler without a texture is a warning
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    const index = gl.getAttribLocation(program, 'index');
    gl.enableVertexAttribArray(index);
    gl.vertexAttribIPointer(index, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(index, 1);
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  // A texture of a name in the shader.
  unit(name, unit) {
    const gl = this.gl;
    gl.uniform1i(this.at[name], unit);
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }

  upload(unit, width, rows, words) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, width, rows, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, words);
  }

  // Bytes as whole rows of a texture; null: more than this browser has.
  rowsOf(bytes, rowBytes) {
    const rows = Math.max(1, Math.ceil(bytes.length / rowBytes));
    if (rows > this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE)) return null;
    const texels = new Uint8Array(rows * rowBytes);
    texels.set(bytes);
    return texels;
  }

  // Whole records, and their SH of a degree. The old model is drawn until the new one is sorted; what comes meanwhile
  // waits, the newest alone, or a slow machine would never come to draw one.
  set(bytes, antialiased, sh = new Uint8Array(0), degree = 0) {
    if (this.texels) {
      this.next = [bytes, antialiased, sh, degree];
      return;
    }
    const count = Math.floor(bytes.length / SPLAT_BYTES);
    const texels = this.rowsOf(bytes.subarray(0, count * SPLAT_BYTES), ROW_SPLATS * SPLAT_BYTES);
    if (!texels) throw new Error(`${count} Gaussians are more than this browser can draw`);
    const shades = degree ? this.rowsOf(sh, 16 * SH_ROW) : null; // too many: without
    const floats = new Float32Array(texels.buffer), means = new Float32Array(3 * count);
    for (let i = 0; i < count; i++) means.set(floats.subarray(8 * i, 8 * i + 3), 3 * i);
    Object.assign(this, { bytes, antialiased, sh, degree, count, texels, shades, means, model: this.model + 1, row: '' });
    this.worker.postMessage({ means: means.slice() });
    this.changed();
  }

  take({ order, serial, model }) {
    this.sorted = serial;
    if (model === this.model) {
      const gl = this.gl;
      if (this.texels) this.show(this.texels, this.shades);
      this.texels = this.shades = null;
      gl.bufferData(gl.ARRAY_BUFFER, order, gl.DYNAMIC_DRAW);
      this.drawn = order.length;
    }
    if (this.next && !this.texels) {
      const next = this.next;
      this.next = null;
      this.set(...next);
    }
    this.changed();
  }

  // Of the model that has been sorted.
  show(texels, shades) {
    this.upload(0, 2 * ROW_SPLATS, texels.length / (ROW_SPLATS * SPLAT_BYTES), new Uint32Array(texels.buffer));
    if (shades) this.upload(1, SH_ROW, shades.length / (16 * SH_ROW), new Uint32Array(shades.buffer));
    this.blends = this.antialiased;
    this.shaded = shades ? this.degree : 0;
  }

  // Whether what is drawn is sorted for the view that was asked for last.
  get settled() { return this.sorted === this.serial && !this.texels; }

  sort(camera) {
    const row = [camera.R[6], camera.R[7], camera.R[8], camera.t[2], camera.near], text = row.join();
    if (text === this.row || this.sorted !== this.serial) return; // one at a time
    this.row = text;
    this.worker.postMessage({ row, serial: ++this.serial, model: this.model });
  }

  // camera: R, t, focal [2], middle [2] (px of the canvas), near, background [3].
  draw(camera) {
    const gl = this.gl, { width, height } = this.canvas;
    this.sort(camera);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...camera.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.uniformMatrix3fv(this.at.R, true, camera.R);
    gl.uniform3fv(this.at.t, camera.t);
    gl.uniform2fv(this.at.focal, camera.focal);
    gl.uniform2fv(this.at.middle, camera.middle);
    gl.uniform2f(this.at.size, width, height);
    gl.uniform2f(this.at.limit, 0.65 * width / camera.focal[0], 0.65 * height / camera.focal[1]);
    gl.uniform1f(this.at.near, camera.near);
    gl.uniform1i(this.at.antialiased, this.blends ? 1 : 0);
    gl.uniform1i(this.at.degree, this.shaded || 0);
    if (this.drawn) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.drawn);
  }
}
