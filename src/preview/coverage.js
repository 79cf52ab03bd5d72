'use strict';
// coverage.js - which parts of the scene are covered badly, laid over the camera's picture, and the way to the worst.

const RED = [217, 48, 38], AMBER = [240, 170, 40], GREEN = [46, 160, 80];

// 0 red, 1 green.
function coverageColor(v) {
  const [a, b, t] = v < 0.5 ? [RED, AMBER, 2 * v] : [AMBER, GREEN, 2 * v - 1];
  return a.map((x, i) => Math.round(x + t * (b[i] - x)));
}

const soundCoverage = c => c && Number.isInteger(c.width) && Number.isInteger(c.height) && c.width > 0 && c.height > 0 &&
  typeof c.values === 'string' && c.values.length === c.width * c.height ? c : null;

// The overlay, in its own small size.
function coverageImage(coverage) {
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [coverage.width, coverage.height];
  const c = canvas.getContext('2d'), image = c.createImageData(coverage.width, coverage.height);
  for (let i = 0; i < coverage.values.length; i++) {
    const v = coverage.values.charCodeAt(i) - 48;
    if (v < 0 || v > 9) continue;
    // What is covered well need not be hidden.
    image.data.set([...coverageColor(v / 9), 150 - 9 * v], 4 * i);
  }
  c.putImageData(image, 0, 0);
  return canvas;
}

// Where a point of the world lies: px of the picture where it is in sight, else a place at its edge, with the direction to it.
function wayTo(world, p, picture, margin) {
  const q = add(apply(p.R_cw, world), p.t_cw), scale = picture.width / p.width, front = q[2] > 1e-9;
  const x = (front ? p.fx * q[0] / q[2] + p.cx : p.cx) * scale, y = (front ? p.fy * q[1] / q[2] + p.cy : p.cy) * scale;
  const inside = front && x >= margin && y >= margin && x <= picture.width - margin && y <= picture.height - margin;
  if (inside) return { x, y, inside };
  let [dx, dy] = front ? [x - picture.width / 2, y - picture.height / 2] : [q[0], q[1]];
  if (Math.hypot(dx, dy) < 1e-9) [dx, dy] = [1, 0]; // straight behind
  const [w, h] = [picture.width / 2 - margin, picture.height / 2 - margin];
  const reach = Math.min(w / Math.max(Math.abs(dx), 1e-9), h / Math.max(Math.abs(dy), 1e-9));
  return { x: picture.width / 2 + dx * reach, y: picture.height / 2 + dy * reach, angle: Math.atan2(dy, dx), inside };
}

// `pixel`: of the picture, a px of the screen.
function drawWay(c, way, text, picture, pixel) {
  const size = 13 * pixel;
  c.save();
  c.translate(way.x, way.y);
  c.lineJoin = 'round';
  c.beginPath();
  if (way.inside) {
    c.arc(0, 0, size, 0, 2 * Math.PI);
  } else {
    c.rotate(way.angle);
    c.moveTo(size, 0);
    for (const [x, y] of [[-0.2, -0.9], [-0.2, -0.35], [-1, -0.35], [-1, 0.35], [-0.2, 0.35], [-0.2, 0.9]]) c.lineTo(x * size, y * size);
    c.closePath();
  }
  for (const [width, style] of [[6, '#000b'], [2.5, '#fff']]) {
    c.lineWidth = width * pixel;
    c.strokeStyle = style;
    c.stroke();
  }
  if (!way.inside) {
    c.fillStyle = `rgb(${RED})`;
    c.fill();
  }
  c.restore();
  if (!text) return;
  c.font = `600 ${13 * pixel}px sans-serif`;
  const width = c.measureText(text).width, pad = 6 * pixel, top = 12 * pixel;
  const x = Math.min(Math.max(way.x - width / 2, 2 * pad), picture.width - width - 2 * pad);
  const y = way.y + size + 2.2 * top > picture.height ? way.y - size - 2 * top : way.y + size + 0.5 * top;
  c.fillStyle = '#000b';
  c.fillRect(x - pad, y, width + 2 * pad, 1.8 * top);
  c.fillStyle = '#fff';
  c.fillText(text, x, y + 1.3 * top);
}

function drawCoverage(c, coverage, p, picture, pixel) {
  c.imageSmoothingEnabled = true;
  c.drawImage(coverageImage(coverage), 0, 0, picture.width, picture.height);
  const worst = Array.isArray(coverage.worst) && coverage.worst.length === 3 && coverage.worst.every(Number.isFinite);
  if (worst) drawWay(c, wayTo(coverage.worst, p, picture, 22 * pixel), coverage.worst_says, picture, pixel);
}
