#!/bin/bash
# compressed_ply_sh_zero.sh - in a compressed .ply no byte stands for a spherical-harmonics coefficient of 0.
#
# The coefficients above band 0 are bytes over -4..4. A byte in between comes back as the middle of its 256th part, and 0 lies on
# the border of two parts. Most coefficients of a trained model are about 0, and one would expect 0 to come back as 0, at least of a
# model that has none but zeros. Each comes back as 1/64, all with the same sign: the colours become directional.
set -euo pipefail

version=3.7.0
expected='27 of 27 zeros come back as 0.015625; -0.01 comes back as -0.015625, 0.01 as 0.015625, 4 as 4'
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
npm init -y >/dev/null
npm install --silent --no-fund --no-audit --ignore-scripts "@playcanvas/splat-transform@$version" >/dev/null 2>&1
transform=(node_modules/.bin/splat-transform --quiet --overwrite --gpu cpu)

# Four Gaussians of degree 1, three with zeros alone; in the last the first three coefficients are -0.01, 0.01 and 4.
cat >make.js <<'EOF'
const fs = require('fs');
const names = ['x', 'y', 'z', 'f_dc_0', 'f_dc_1', 'f_dc_2'];
for (let i = 0; i < 9; i++) names.push(`f_rest_${i}`);
names.push('opacity', 'scale_0', 'scale_1', 'scale_2', 'rot_0', 'rot_1', 'rot_2', 'rot_3');
const header = 'ply\nformat binary_little_endian 1.0\nelement vertex 4\n' +
    names.map(name => `property float ${name}\n`).join('') + 'end_header\n';
const data = Buffer.alloc(4 * 4 * names.length);
for (let i = 0; i < 4; i++) {
    const sh = i === 3 ? [-0.01, 0.01, 4] : [0, 0, 0];
    const row = [i, i % 2, 5, 0.1, 0.2, 0.3, ...sh, 0, 0, 0, 0, 0, 0, 1, -3, -3, -3, 1, 0, 0, 0];
    row.forEach((value, k) => data.writeFloatLE(value, 4 * (i * names.length + k)));
}
fs.writeFileSync('in.ply', Buffer.concat([Buffer.from(header), data]));
EOF
cat >compare.js <<'EOF'
const fs = require('fs');
const file = fs.readFileSync('out.ply'), start = file.indexOf('end_header\n') + 11;
const names = [...file.toString('latin1', 0, start).matchAll(/property float (\S+)/g)].map(match => match[1]);
const value = (i, field) => file.readFloatLE(start + 4 * (i * names.length + names.indexOf(field)));
const zeros = [], others = [];
for (let i = 0; i < 4; i++) {
    const list = Math.round(value(i, 'x')) === 3 ? others : zeros;
    for (let k = 0; k < 9; k++) list.push(value(i, `f_rest_${k}`));
}
const same = zeros.filter(v => v === zeros[0]).length;
console.log(`${same} of ${zeros.length} zeros come back as ${zeros[0]}; -0.01 comes back as ${others[0]}, 0.01 as ${others[1]}, 4 as ${others[2]}`);
EOF
node make.js
"${transform[@]}" in.ply middle.compressed.ply
"${transform[@]}" middle.compressed.ply out.ply
seen=$(node compare.js)
echo "splat-transform $version: $seen"
[ "$seen" = "$expected" ] || { echo "expected: $expected"; exit 1; }
