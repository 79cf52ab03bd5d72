#!/bin/bash
# sog_opacity_floor.sh - splat-transform writes the opacity of a .sog rounded down, not to the nearest of its 256 values.
#
# The opacities of a .splat are 8 bits already, and so are those of a .sog: one would expect all 256 to come
# through. Half of them come out one step lower, opaque Gaussians among them (255 becomes 254). Each further round trip takes another step from
# some of them: after five the worst has lost 5.
set -euo pipefail

version=3.7.0
expected='255 -> 254, 254 -> 254, 128 -> 128, 1 -> 0; 128 of 256 one step lower, 0 higher; after 4 more round trips 5 steps at most'
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
npm init -y >/dev/null
npm install --silent --no-fund --no-audit --ignore-scripts "@playcanvas/splat-transform@$version" >/dev/null 2>&1
transform=(node_modules/.bin/splat-transform --quiet --overwrite --gpu cpu)

# 256 Gaussians in a row, x = the opacity in steps of 1/255.
cat >make.js <<'END'
const fs = require('fs');
const bytes = Buffer.alloc(32 * 256);
for (let i = 0; i < 256; i++) {
    const at = 32 * i;
    [i, 0, 5, 0.1, 0.1, 0.1].forEach((value, k) => bytes.writeFloatLE(value, at + 4 * k));
    bytes.set([200, 100, 50, i, 255, 128, 128, 128], at + 24);
}
fs.writeFileSync('0.splat', bytes);
END
cat >compare.js <<'END'
const fs = require('fs');
const opacities = name => {
    const file = fs.readFileSync(name), start = file.indexOf('end_header\n') + 11;
    const names = [...file.toString('latin1', 0, start).matchAll(/property float (\S+)/g)].map(match => match[1]);
    const value = (i, field) => file.readFloatLE(start + 4 * (i * names.length + names.indexOf(field)));
    const found = new Map();
    for (let i = 0; i < (file.length - start) / 4 / names.length; i++)
        found.set(Math.round(value(i, 'x')), Math.round(255 / (1 + Math.exp(-value(i, 'opacity')))));
    return found;
};
const once = opacities('1.ply'), often = opacities('5.ply');
const count = test => [...once].filter(([before, after]) => test(after - before)).length;
const fall = Math.max(...[...often].map(([before, after]) => before - after));
console.log([255, 254, 128, 1].map(i => `${i} -> ${once.get(i)}`).join(', ') +
    `; ${count(d => d === -1)} of ${once.size} one step lower, ${count(d => d > 0)} higher; after 4 more round trips ${fall} steps at most`);
END
node make.js
"${transform[@]}" 0.splat 0.ply
for i in 1 2 3 4 5; do
    "${transform[@]}" $((i - 1)).ply $i.sog
    "${transform[@]}" $i.sog $i.ply
done
seen=$(node compare.js)
echo "splat-transform $version: $seen"
[ "$seen" = "$expected" ] || { echo "expected: $expected"; exit 1; }
