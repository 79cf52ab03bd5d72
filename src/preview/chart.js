'use strict';
// chart.js - PSNR over time, drawn by hand: axes with round numbers, two curves, the value under the pointer.

const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// Fits the canvas' pixels to its place on the screen; its size there in CSS px.
function fitCanvas(canvas, most = 2) {
  const ratio = Math.min(window.devicePixelRatio || 1, most);
  const width = canvas.clientWidth, height = canvas.clientHeight;
  const w = Math.max(1, Math.round(width * ratio)), h = Math.max(1, Math.round(height * ratio));
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  return { width, height, ratio };
}

// Steps of 1, 2 or 5 times a power of ten, about `wanted` of them between two values.
function roundStep(range, wanted) {
  const rough = range / wanted, power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5, 10].find(m => m * power >= rough) || 10);
}

// Of a time axis: seconds, minutes or hours, with round steps in each.
function timeUnit(most) {
  if (most <= 180) return { size: 1, name: 's' };
  return most <= 3 * 3600 ? { size: 60, name: 'min' } : { size: 3600, name: 'h' };
}

class QualityChart {
  constructor(canvas, facts) {
    Object.assign(this, { canvas, facts, points: [], pointer: null });
    const move = e => { this.pointer = e.offsetX; this.draw(); };
    canvas.addEventListener('pointermove', move);
    canvas.addEventListener('pointerdown', move);
    canvas.addEventListener('pointerleave', () => { this.pointer = null; this.draw(); });
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.draw());
  }

  // [[seconds, held out or null, tracked or null], ...]
  set(points) {
    this.points = points;
    this.draw();
  }

  bounds() {
    const values = this.points.flatMap(p => [p[1], p[2]]).filter(v => v !== null);
    let low = Math.min(...values), high = Math.max(...values);
    if (high - low < 1) [low, high] = [(low + high) / 2 - 0.5, (low + high) / 2 + 0.5];
    const step = roundStep(high - low, 4);
    const most = Math.max(this.points[this.points.length - 1][0], 1e-3);
    return { low: Math.floor(low / step) * step, high: Math.ceil(high / step) * step, step, most };
  }

  draw() {
    const { width, height, ratio } = fitCanvas(this.canvas), c = this.canvas.getContext('2d');
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    c.font = `12px ${getComputedStyle(document.body).fontFamily}`;
    if (!this.points.length) {
      c.fillStyle = css('--soft');
      c.textAlign = 'center';
      c.fillText('no held-out picture was measured yet', width / 2, height / 2);
      this.facts.textContent = '';
      return;
    }
    const b = this.bounds(), left = 44, right = width - 14, top = 30, bottom = height - 34;
    this.place = {
      ...b, left, right, top, bottom,
      x: s => left + (right - left) * s / b.most, y: v => bottom - (bottom - top) * (v - b.low) / (b.high - b.low),
    };
    this.axes(c);
    this.curve(c, 2, css('--second'), 1.5);
    this.curve(c, 1, css('--init'), 2.25);
    this.legend(c);
    this.reading(c);
  }

  axes(c) {
    const { left, right, top, bottom, low, high, step, most, x, y } = this.place;
    const unit = timeUnit(most), pace = roundStep(most / unit.size, Math.max(2, (right - left) / 90)) * unit.size;
    c.strokeStyle = css('--line');
    c.fillStyle = css('--soft');
    c.lineWidth = 1;
    c.textBaseline = 'middle';
    c.textAlign = 'right';
    for (let v = low; v <= high + step / 2; v += step) {
      c.beginPath();
      c.moveTo(left, Math.round(y(v)) + 0.5);
      c.lineTo(right, Math.round(y(v)) + 0.5);
      c.stroke();
      c.fillText(v.toFixed(step < 1 ? 1 : 0), left - 6, y(v));
    }
    c.textBaseline = 'top';
    c.textAlign = 'center';
    for (let s = 0; s <= most; s += pace) {
      c.beginPath();
      c.moveTo(Math.round(x(s)) + 0.5, bottom);
      c.lineTo(Math.round(x(s)) + 0.5, bottom + 4);
      c.stroke();
      const text = String(+(s / unit.size).toFixed(3));
      if (x(s) < right - 26) c.fillText(text, x(s), bottom + 7);
    }
    c.textAlign = 'right';
    c.fillText(unit.name, right, bottom + 7);
    c.textAlign = 'left';
    c.fillText('PSNR, dB', 6, 8);
    this.unit = unit;
  }

  curve(c, column, color, thickness) {
    const { x, y } = this.place, known = this.points.filter(p => p[column] !== null);
    c.strokeStyle = c.fillStyle = color;
    c.lineWidth = thickness;
    c.lineJoin = 'round';
    c.beginPath();
    known.forEach((p, i) => (i ? c.lineTo : c.moveTo).call(c, x(p[0]), y(p[column])));
    c.stroke();
    if (!known.length) return;
    const last = known[known.length - 1];
    c.beginPath();
    c.arc(x(last[0]), y(last[column]), thickness + 1, 0, 7);
    c.fill();
  }

  // What the curves are, from the right.
  legend(c) {
    let at = this.place.right;
    c.textAlign = 'right';
    c.textBaseline = 'top';
    for (const [column, name, color] of [[2, 'tracked views', '--second'], [1, 'held out', '--init']]) {
      if (!this.points.some(p => p[column] !== null)) continue;
      c.fillStyle = css('--soft');
      c.fillText(name, at, 8);
      at -= c.measureText(name).width + 6;
      c.fillStyle = css(color);
      c.fillRect(at - 12, 12, 12, 3);
      at -= 26;
    }
  }

  // The values at the pointer, else the newest.
  reading(c) {
    const { left, right, top, bottom, most, x, y } = this.place;
    let p = this.points[this.points.length - 1];
    if (this.pointer !== null) {
      const s = most * (this.pointer - left) / (right - left);
      p = this.points.reduce((a, q) => Math.abs(q[0] - s) < Math.abs(a[0] - s) ? q : a);
      c.strokeStyle = css('--soft');
      c.setLineDash([3, 3]);
      c.beginPath();
      c.moveTo(x(p[0]), top);
      c.lineTo(x(p[0]), bottom);
      c.stroke();
      c.setLineDash([]);
      for (const [column, color] of [[1, '--init'], [2, '--second']]) {
        if (p[column] === null) continue;
        c.fillStyle = css(color);
        c.beginPath();
        c.arc(x(p[0]), y(p[column]), 4, 0, 7);
        c.fill();
      }
    }
    const parts = [];
    if (p[1] !== null) parts.push(`${p[1].toFixed(2)} dB held out`);
    if (p[2] !== null) parts.push(`${p[2].toFixed(2)} dB tracked`);
    this.facts.textContent = `${parts.join(', ')} at ${+(p[0] / this.unit.size).toFixed(1)} ${this.unit.name}`;
  }
}
