'use strict';
// orbit.js - the view of the model: where from, and how fingers, mouse and keys move it.
//
// A view is a camera as in camera.h: p_c = R p_w + t with +x right, +y down, +z ahead. Its focal length is in heights of a
// picture of some aspect that fits into the canvas, so that it shows the same on any screen; `shift` is the principal point's.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const rowOf = (R, i) => [R[3 * i], R[3 * i + 1], R[3 * i + 2]];
const apply = (R, p) => [dot(rowOf(R, 0), p), dot(rowOf(R, 1), p), dot(rowOf(R, 2), p)];
const applyTransposed = (R, p) => [0, 1, 2].map(i => R[i] * p[0] + R[3 + i] * p[1] + R[6 + i] * p[2]);
const times = (A, B) => [0, 1, 2].flatMap(i => [0, 1, 2].map(j => A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j]));
const add = (a, b) => a.map((v, i) => v + b[i]);
const subtract = (a, b) => a.map((v, i) => v - b[i]);
const unit = a => { const n = Math.hypot(...a); return a.map(v => v / n); };
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

// By an angle about a unit axis.
function turn([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
  return [c + x * x * d, x * y * d - z * s, x * z * d + y * s, y * x * d + z * s, c + y * y * d, y * z * d - x * s,
    z * x * d - y * s, z * y * d + x * s, c + z * z * d];
}

// Rounding adds up while a view is turned.
function orthonormal(R) {
  const z = unit(rowOf(R, 2)), x = unit(cross(rowOf(R, 1), z));
  return [...x, ...cross(z, x), ...z];
}

class Orbit {
  // `changed` is called when the view has moved; byHand says whether a person did it.
  constructor(canvas, changed) {
    Object.assign(this, { canvas, changed, fingers: new Map(), center: [0, 0, 0], radius: 1, up: null, byHand: false });
    this.view = { R: [1, 0, 0, 0, 1, 0, 0, 0, 1], t: [0, 0, 3], f: 1.2, aspect: 4 / 3, shift: [0, 0] };
    canvas.addEventListener('pointerdown', e => this.down(e));
    canvas.addEventListener('pointermove', e => this.move(e));
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) canvas.addEventListener(name, e => this.fingers.delete(e.pointerId));
    canvas.addEventListener('wheel', e => this.wheel(e), { passive: false });
    canvas.addEventListener('keydown', e => this.key(e));
    canvas.addEventListener('contextmenu', e => e.preventDefault());
  }

  set(view) {
    this.view = view;
    this.changed();
  }

  // Where the model is: the middle of its Gaussians by their means, and the radius of most of them.
  frame(means) {
    const n = means.length / 3, step = Math.max(1, Math.floor(n / 4096)), axes = [[], [], []];
    for (let i = 0; i < n; i += step) for (let k = 0; k < 3; k++) axes[k].push(means[3 * i + k]);
    const center = axes.map(a => [...a].sort((x, y) => x - y)[a.length >> 1]);
    const away = axes[0].map((_, i) => Math.hypot(...subtract([axes[0][i], axes[1][i], axes[2][i]], center))).sort((x, y) => x - y);
    this.center = center;
    this.radius = away[Math.floor(away.length * 0.8)] || 1;
    if (!this.pivot) this.pivot = center;
  }

  // All of the model, from where the view looks now.
  all() {
    const { R, f } = this.view, away = this.radius * f * 2.2;
    this.pivot = this.center;
    this.set({ ...this.view, t: subtract([0, 0, away], apply(R, this.center)), shift: [0, 0] });
  }

  // A camera of the status.
  fromPose(p) {
    const view = {
      R: p.R_cw, t: p.t_cw, f: p.fy / p.height, aspect: p.width / p.height,
      shift: [(p.cx - p.width / 2) / p.fx, (p.cy - p.height / 2) / p.fy],
    };
    this.up = this.up || this.upright(p.R_cw);
    this.pivot = this.ahead(view, this.distance(view));
    this.set(view);
  }

  // The world's axis that is nearest to the picture's up, if any is near.
  upright(R) {
    const up = rowOf(R, 1).map(v => -v), k = [0, 1, 2].reduce((a, b) => Math.abs(up[b]) > Math.abs(up[a]) ? b : a);
    return Math.abs(up[k]) > 0.6 ? [0, 1, 2].map(i => i === k ? Math.sign(up[k]) : 0) : up;
  }

  ahead(view, z) { return applyTransposed(view.R, subtract([0, 0, z], view.t)); }

  // Of the model's middle along the view's axis, or something sound.
  distance(view) {
    const z = apply(view.R, this.center)[2] + view.t[2];
    return z > 0.1 * this.radius ? z : this.radius;
  }

  // px of the canvas.
  camera(width, height) {
    const { R, t, f, aspect, shift } = this.view, focal = f * Math.min(height, width / aspect);
    return {
      R, t, focal: [focal, focal], middle: [width / 2 + shift[0] * focal, height / 2 + shift[1] * focal], near: 0.04 * this.radius,
    };
  }

  // ---- The view as text, for links ----

  toText() {
    const { R, t, f, aspect, shift } = this.view;
    return [...R, ...t, f, aspect, ...shift].map(v => +v.toFixed(6)).join(',');
  }

  // Whether it was one.
  fromText(text) {
    const v = text.split(',').map(Number);
    if (v.length !== 16 || !v.every(Number.isFinite) || !(v[12] > 0) || !(v[13] > 0)) return false;
    const view = { R: orthonormal(v.slice(0, 9)), t: v.slice(9, 12), f: v[12], aspect: v[13], shift: v.slice(14) };
    if (!view.R.every(Number.isFinite)) return false;
    this.up = this.up || this.upright(view.R);
    this.pivot = null;
    this.set(view);
    return true;
  }

  // ---- By hand ----

  hand() {
    this.byHand = true;
    if (!this.up) this.up = this.upright(this.view.R);
    if (!this.pivot) this.pivot = this.ahead(this.view, this.distance(this.view));
  }

  // Turns the scene about the pivot.
  about(axis, angle) {
    const { R, t } = this.view, Q = turn(axis, angle), c = this.pivot;
    this.view = { ...this.view, R: orthonormal(times(R, Q)), t: add(apply(R, subtract(c, apply(Q, c))), t) };
  }

  orbit(dx, dy) {
    this.hand();
    this.about(this.up, dx);
    this.about(rowOf(this.view.R, 0), dy);
    this.changed();
  }

  zoom(factor) {
    this.hand();
    const { R, t } = this.view, z = apply(R, this.pivot)[2] + t[2];
    const change = Math.max(z, 0.02 * this.radius) * (factor - 1);
    this.set({ ...this.view, t: [t[0], t[1], t[2] + change] });
  }

  pan(dx, dy) {
    this.hand();
    const { R, t } = this.view, z = Math.max(apply(R, this.pivot)[2] + t[2], 0.02 * this.radius);
    const scale = z / this.camera(this.canvas.clientWidth, this.canvas.clientHeight).focal[0];
    this.view = { ...this.view, t: [t[0] + dx * scale, t[1] + dy * scale, t[2]] };
    this.pivot = this.ahead(this.view, z);
    this.changed();
  }

  down(e) {
    this.canvas.setPointerCapture(e.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.fingers.set(e.pointerId, [e.offsetX, e.offsetY]);
  }

  move(e) {
    const before = this.fingers.get(e.pointerId), now = [e.offsetX, e.offsetY];
    if (!before) return;
    const by = subtract(now, before);
    if (this.fingers.size > 1) this.pinch(e.pointerId, now);
    else if (e.shiftKey || e.buttons & 6) this.pan(...by);
    else this.orbit(...by.map(v => v * 2.5 / Math.min(this.canvas.clientWidth, this.canvas.clientHeight)));
    this.fingers.set(e.pointerId, now);
  }

  // Two fingers: what lies between them moves and grows with them.
  pinch(id, now) {
    const others = [...this.fingers].filter(([other]) => other !== id), other = others[0][1], before = this.fingers.get(id);
    const was = Math.hypot(...subtract(before, other)), is = Math.hypot(...subtract(now, other));
    this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    if (was > 5 && is > 5) this.zoom(was / is);
  }

  wheel(e) {
    e.preventDefault();
    this.zoom(Math.exp(Math.max(-200, Math.min(200, e.deltaY * (e.deltaMode ? 30 : 1))) * 0.0015));
  }

  key(e) {
    const moves = {
      ArrowLeft: [-0.08, 0], ArrowRight: [0.08, 0], ArrowUp: [0, -0.08], ArrowDown: [0, 0.08],
    }, zooms = { '+': 0.9, '=': 0.9, '-': 1.1 };
    if (!moves[e.key] && !zooms[e.key]) return;
    e.preventDefault();
    if (zooms[e.key]) this.zoom(zooms[e.key]);
    else this.orbit(...moves[e.key]);
  }
}
