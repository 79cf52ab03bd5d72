#!/bin/bash
# gltf_scale_unit.sh - KHR_gaussian_splatting:SCALE is a logarithm in splat-transform's .glb up to 2.3.1, a length since.
#
# Both files name the same extension and no version of it, and both are valid glTF: only `asset.generator`, which a reader
# should not have to trust, and the range of the values tell them apart. A length of 0.1 read as a logarithm is 11 times as
# large as it should be; a logarithm of -2.3 read as a length is negative.
set -euo pipefail

expected=$'2.3.1: SCALE -2.3026\n2.7.1: SCALE 0.1000\n3.7.0: SCALE 0.1000\nbut for scale and generator alike: yes'
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"

# One Gaussian, round, with a standard deviation of 0.1.
cat >make.js <<'END'
const bytes = Buffer.alloc(32);
[0, 0, 5, 0.1, 0.1, 0.1].forEach((value, k) => bytes.writeFloatLE(value, 4 * k));
bytes.set([200, 100, 50, 128, 255, 128, 128, 128], 24);
require('fs').writeFileSync('one.splat', bytes);
END
cat >scale.js <<'END'
const fs = require('fs');
const read = version => {
    const file = fs.readFileSync(`${version}.glb`), length = file.readUInt32LE(12);
    const json = JSON.parse(file.toString('utf8', 20, 20 + length));
    const accessor = json.accessors[json.meshes[0].primitives[0].attributes['KHR_gaussian_splatting:SCALE']];
    const view = json.bufferViews[accessor.bufferView];
    const at = 28 + length + (view.byteOffset || 0) + (accessor.byteOffset || 0);
    return { scale: file.readFloatLE(at).toFixed(4), text: JSON.stringify({ ...json, asset: 0 }) };
};
const versions = process.argv.slice(2), files = versions.map(read);
versions.forEach((version, i) => console.log(`${version}: SCALE ${files[i].scale}`));
console.log(`but for scale and generator alike: ${files.every(file => file.text === files[0].text) ? 'yes' : 'no'}`);
END
node make.js
for version in 2.3.1 2.7.1 3.7.0; do
    mkdir $version
    (cd $version && npm init -y && npm install --no-fund --no-audit --ignore-scripts "@playcanvas/splat-transform@$version") >/dev/null 2>&1
    $version/node_modules/.bin/splat-transform --quiet --overwrite one.splat $version.glb
done
seen=$(node scale.js 2.3.1 2.7.1 3.7.0)
echo "splat-transform $seen"
[ "$seen" = "$expected" ] || { printf 'expected:\n%s\n' "$expected"; exit 1; }
